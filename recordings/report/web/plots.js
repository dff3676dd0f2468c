// The figures over time: a plot a panel, all drawn by plotly.

const plots = {
  drawn: [], // { panel, box, plot }
  joint: 0,
  window: 0, // s up to the end that are drawn; all if 0
  end: 0,
  dashes: { solid: "", dash: "6 4", dot: "2 3", dashdot: "8 3 2 3", longdash: "12 4" },

  async take({ figures, library, runs }) {
    this.lay(figures);
    this.end = Math.max(...runs.map(({ seconds }) => seconds));
    await library;
    for (const one of this.drawn) {
      this.name(one);
      await Plotly.react(one.plot, this.traces(one.panel), this.layout(one), {
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
        const box = make("div", { className: "panel" }, make("h3", {}, ...wrapped(panel.label)), plot,
          ...(panel.legend ? [make("ul", { className: "legend" })] : []));
        inner.append(box);
        this.drawn.push({ panel, box, plot });
      }
      const section = make("section", { id: `figure-${figure.name}` },
        make("h2", { textContent: figure.title }),
        make("p", { className: "about" }, ...indexed(figure.about)));
      if (joints.size > 3) section.append(this.chooser(figure.panels));
      section.append(inner);
      return section;
    }));
    this.choose(panels.some(({ joint }) => joint > 2) ? 0 : null);
  },

  name({ panel, box }) {
    $(".legend", box)?.replaceChildren(...panel.curves.map(({ name, ink, dash, width }) =>
      make("li", {}, make("i", { innerHTML: `<svg viewBox="0 0 34 8"><path d="M1 4H33" fill="none" stroke="var(${ink === null ? "--ink" : `--ink-${ink % 8}`})" stroke-width="${Math.max(width, 2.2)}" stroke-dasharray="${this.dashes[dash]}"/></svg>` }),
        make("span", {}, ...wrapped(name)))));
  },

  chooser(panels) {
    const names = new Map(panels.filter(({ joint }) => joint !== null).map((panel) => [panel.joint, panel.joint_name]));
    return make("div", { className: "joints" }, ...[...names].map(([joint, name]) => {
      const button = make("button", { type: "button" }, ...breakable(name || `joint ${joint + 1}`));
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
    return [...panel.bands.map((band) => this.band(band)), ...panel.curves.map((curve) => ({
      type: "scatter",
      mode: curve.marks ? "lines+markers" : "lines",
      name: indexedHtml(curve.name),
      ...this.seen(page.arrays[curve.x], page.arrays[curve.y]),
      line: { color: theme.ink(curve.ink), dash: curve.dash, width: curve.width * (panel.rows.length ? 1 : 1.7) },
      marker: { color: theme.ink(curve.ink), size: 5 },
      hovertemplate: panel.rows.length ? "%{y}, t = %{x:.3f} s" : "%{y:.5g} at t = %{x:.3f} s",
      visible: shown.has(curve.group),
    }))];
  },

  // the part of a curve that is in the window; a row of link events is short, and stays whole
  seen(x, ...ys) {
    const since = this.window ? x.findIndex((t) => t >= this.end - this.window) : 0;
    const [y, other] = ys.map((values) => values.slice(since < 0 ? values.length : since));
    return { x: x.slice(since < 0 ? x.length : since), y, other };
  },

  // an outline a stretch without gaps: along the upper edge, and back along the lower
  band({ name, group, x, low, high, ink, opacity }) {
    const { x: t, y: below, other: above } = this.seen(page.arrays[x], page.arrays[low], page.arrays[high]);
    const outline = { x: [], y: [] };
    for (let begin = 0; begin < t.length; begin++) {
      if (Number.isNaN(below[begin])) continue;
      let end = begin;
      while (end < t.length && !Number.isNaN(below[end])) end++;
      outline.x.push(...t.slice(begin, end), ...t.slice(begin, end).reverse(), null);
      outline.y.push(...above.slice(begin, end), ...below.slice(begin, end).reverse(), null);
      begin = end;
    }
    const alpha = Math.round(opacity * 255).toString(16).padStart(2, "0");
    return { type: "scatter", mode: "lines", name, ...outline, fill: "toself", line: { width: 0 },
      fillcolor: theme.ink(ink) + alpha, hoverinfo: "skip", visible: shown.has(group) };
  },

  layout({ panel, plot }) {
    const ink = theme.colour("--ink"), line = theme.colour("--line"), soft = theme.colour("--soft");
    const font = { family: getComputedStyle(document.body).fontFamily, size: 16, color: soft };
    const axis = { gridcolor: line, linecolor: line, zerolinecolor: line, zerolinewidth: 1, tickfont: font, automargin: true };
    return {
      font, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", uirevision: "kept",
      margin: { l: 8, r: this.labelled(panel, plot) ? 180 : 10, t: 8, b: 8 }, hovermode: "closest", dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom",
      hoverlabel: { font: { ...font, color: ink }, bgcolor: theme.colour("--card"), bordercolor: line },
      showlegend: false,
      annotations: this.labelled(panel, plot) ? this.labels(panel, plot, font) : [],
      xaxis: { ...axis, title: { text: "simulated time (s)", font, standoff: 6 }, nticks: 7,
        ...(this.window ? { range: [Math.max(this.end - this.window, 0), this.end] } : panel.labels.length ? { range: [0, this.end] } : { rangemode: "tozero" }) },
      yaxis: { ...axis, nticks: 6,
        ...(panel.logarithmic ? { type: "log", tickformat: "~g", nticks: this.ticks(panel),
          ...(panel.y_range && !this.window ? { range: panel.y_range.map(Math.log10) } : {}) } : {}),
        ...(panel.rows.length ? { tickvals: panel.rows.map((_, at) => at), ticktext: panel.rows,
          range: [panel.rows.length - 0.4, -0.6], zeroline: false } : {}) },
    };
  },

  // Of 1 to 2 decades 1, 2 and 5 of each are marked, of more each power of ten up to 8 of them, and of
  // less some in even steps, so that there are at least two; "~g" writes them in full, as 0.2.
  ticks({ y_range: range }) {
    const decades = range ? Math.log10(range[1] / range[0]) : 3;
    return decades < 1 ? 5 : Math.min(Math.max(Math.ceil(decades), 3), 8);
  },

  labelled(panel, plot) { return panel.labels.length && !this.window && plot.clientWidth > 460; },

  labels({ labels }, plot, font) {
    return labels.map(({ text, x, y, shift, ink }) => ({
      text: indexedHtml(text), x, y: Math.log10(y), ax: 16, ay: -shift * (plot.clientHeight - 60), xanchor: "left",
      font: { ...font, size: 15, color: theme.ink(ink) }, arrowhead: 0, arrowwidth: 1, arrowcolor: theme.ink(ink),
    }));
  },

  show() {
    for (const { panel, plot } of this.drawn)
      if (plot.data)
        Plotly.restyle(plot, { visible: [...panel.bands, ...panel.curves].map(({ group }) => shown.has(group)) });
  },

  recolour() {
    for (const one of this.drawn)
      if (one.plot.data) Plotly.react(one.plot, this.traces(one.panel), this.layout(one));
  },
};
