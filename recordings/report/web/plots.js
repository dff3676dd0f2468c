// The figures over time: a plot a panel, all drawn by plotly.

const plots = {
  drawn: [], // { panel, box, plot }
  joint: 0,

  async take({ figures, library }) {
    this.lay(figures);
    await library;
    for (const one of this.drawn) {
      this.name(one);
      await Plotly.react(one.plot, this.traces(one.panel), this.layout(one.panel), {
        responsive: true, displaylogo: false, scrollZoom: false,
        displayModeBar: false,
      });
      await new Promise((done) => setTimeout(done));
    }
  },

  lay(figures) {
    const shape = JSON.stringify(figures.map(({ name, panels }) => [name, panels.map(({ label }) => label)]));
    const panels = figures.flatMap((figure) => figure.panels);
    if (shape === this.shape) {
      this.drawn.forEach((one, at) => { one.panel = panels[at]; });
      return;
    }
    this.shape = shape;
    this.drawn = [];
    $("#figures").replaceChildren(...figures.map((figure) => {
      const joints = new Set(figure.panels.map(({ joint }) => joint).filter((joint) => joint !== null));
      const inner = make("div", { className: "panels" });
      inner.style.setProperty("--columns", Math.min(figure.columns, figure.panels.length));
      for (const panel of figure.panels) {
        const plot = make("div", { className: panel.rows.length ? "plot rows" : "plot" });
        plot.style.setProperty("--rows", panel.rows.length);
        const box = make("div", { className: "panel" }, make("h3", {}, ...indexed(panel.label)), plot,
          ...(panel.legend ? [make("ul", { className: "legend" })] : []));
        inner.append(box);
        this.drawn.push({ panel, box, plot });
      }
      const section = make("section", { id: `figure-${figure.name}` },
        make("h2", { textContent: figure.title }),
        make("p", { className: "about" }, ...indexed(figure.about)));
      if (joints.size > 3) section.append(this.chooser(joints));
      section.append(inner);
      return section;
    }));
    this.choose(panels.some(({ joint }) => joint > 2) ? 0 : null);
  },

  name({ panel, box }) {
    $(".legend", box)?.replaceChildren(...panel.curves.map(({ name, ink, dash, width }) => {
      const line = make("i");
      line.style.borderTop = `${Math.max(width, 2.5)}px ${{ dash: "dashed", dot: "dotted" }[dash] ?? "solid"} var(${ink === null ? "--ink" : `--ink-${ink % 8}`})`;
      return make("li", {}, line, make("span", {}, ...indexed(name)));
    }));
  },

  chooser(joints) {
    return make("div", { className: "joints" }, ...[...joints].map((joint) => {
      const button = make("button", { type: "button", textContent: `joint ${joint + 1}` });
      button.dataset.joint = joint;
      button.addEventListener("click", () => this.choose(joint));
      return button;
    }));
  },

  choose(joint) {
    for (const button of document.querySelectorAll(".joints button"))
      button.setAttribute("aria-pressed", Number(button.dataset.joint) === joint);
    for (const { panel, box, plot } of this.drawn) {
      box.hidden = joint !== null && panel.joint !== null && panel.joint !== joint;
      if (!box.hidden && plot.data) Plotly.Plots.resize(plot);
    }
  },

  traces(panel) {
    return panel.curves.map((curve) => ({
      type: "scatter",
      mode: curve.marks ? "lines+markers" : "lines",
      name: indexedHtml(curve.name),
      x: page.arrays[curve.x],
      y: page.arrays[curve.y],
      line: { color: theme.ink(curve.ink), dash: curve.dash, width: curve.width * (panel.rows.length ? 1 : 1.7) },
      marker: { color: theme.ink(curve.ink), size: 5 },
      hovertemplate: panel.rows.length ? "%{y}, t = %{x:.3f} s" : "%{y:.5g} at t = %{x:.3f} s",
      visible: shown.has(curve.group),
    }));
  },

  layout(panel) {
    const ink = theme.colour("--ink"), line = theme.colour("--line"), soft = theme.colour("--soft");
    const font = { family: getComputedStyle(document.body).fontFamily, size: 16, color: soft };
    const axis = { gridcolor: line, linecolor: line, zerolinecolor: line, zerolinewidth: 1, tickfont: font, automargin: true };
    return {
      font, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", uirevision: "kept",
      margin: { l: 8, r: 10, t: 8, b: 8 }, hovermode: "closest", dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
      hoverlabel: { font: { ...font, color: ink }, bgcolor: theme.colour("--card"), bordercolor: line },
      showlegend: false,
      xaxis: { ...axis, title: { text: "simulated time (s)", font, standoff: 6 }, nticks: 7, rangemode: "tozero" },
      yaxis: { ...axis, nticks: 6,
        ...(panel.logarithmic ? { type: "log", exponentformat: "power", dtick: 1 } : {}),
        ...(panel.rows.length ? { tickvals: panel.rows.map((_, at) => at), ticktext: panel.rows,
          range: [panel.rows.length - 0.4, -0.6], zeroline: false } : {}) },
    };
  },

  show() {
    for (const { panel, plot } of this.drawn)
      if (plot.data) Plotly.restyle(plot, { visible: panel.curves.map(({ group }) => shown.has(group)) });
  },

  recolour() {
    for (const { panel, plot } of this.drawn)
      if (plot.data) Plotly.react(plot, this.traces(panel), this.layout(panel));
  },
};
