// The page around the figures: its data, its colours, what is said in words, what is shown.

const $ = (selector, inside = document) => inside.querySelector(selector);

function make(kind, properties = {}, ...children) {
  const element = Object.assign(document.createElement(kind), properties);
  element.append(...children);
  return element;
}

// "ε_i" with its index below the line; only the paper's symbols have any, "x86_64" is left alone
const symbol = /(?<![A-Za-z0-9_])([ευeėqt]\u0307?)_([ik\d])(?!\w)/g;
function indexed(text) {
  return text.replace(symbol, "$1\u0000$2\u0000").split("\u0000")
    .map((part, at) => (at % 2 ? make("sub", { textContent: part }) : part));
}
const indexedHtml = (text) =>
  text.replace(/[&<>]/g, (c) => `&#${c.charCodeAt(0)};`).replace(symbol, "$1<sub>$2</sub>");

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

function decoded(arrays) {
  return arrays.map(({ kind, data }) =>
    kind === "f4" ? new Float32Array(bytes(data).buffer) : new Float64Array(bytes(data).buffer));
}

async function inflated(text) {
  const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

const theme = {
  wish: matchMedia("(prefers-color-scheme: dark)"),
  get dark() {
    const chosen = $("#theme").value;
    return chosen === "auto" ? this.wish.matches : chosen === "dark";
  },
  apply() {
    document.documentElement.toggleAttribute("data-dark", this.dark);
    plots.recolour();
    picture.draw();
  },
  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  },
  ink(number) {
    return this.colour(number === null ? "--ink" : `--ink-${number % 8}`);
  },
};

const shown = {
  hidden: new Set(),
  has(group) { return !this.hidden.has(group); },
  turn(group, alone) {
    const names = page.groups.map(({ name }) => name);
    if (alone) {
      const others = names.filter((name) => name !== group && name !== "target");
      const was = others.every((name) => this.hidden.has(name)) && this.has(group);
      this.hidden = new Set(was ? [] : others);
    } else if (!this.hidden.delete(group)) this.hidden.add(group);
    this.tell();
  },
  tell() {
    for (const button of document.querySelectorAll("#groups button"))
      button.setAttribute("aria-pressed", this.has(button.dataset.group));
    for (const node of document.querySelectorAll(".node"))
      node.classList.toggle("off", page.runs.length === 1 && !this.has(nodeGroup(node.dataset.robot)));
    plots.show();
    picture.draw();
  },
};
const nodeGroup = (robot) => (robot === "0" ? "target" : `robot ${robot}`);

let page = null; // what is shown now

function render(data) {
  page = data;
  page.arrays = decoded(data.arrays);
  const names = data.runs.map(({ name }) => name);
  document.title = `${names.join(", ")} – nrs report`;
  $("#title").textContent = names.join(" and ");
  sayWords(data.runs);
  listGroups(data);
  drawNetworks(data.runs);
  tellTheory(data.runs);
  tellNumbers(data.runs);
  picture.take(data);
  shown.tell();
  return plots.take(data);
}

const four = (number) => Number(number.toPrecision(4)).toString();

function sayWords(runs) {
  const several = runs.length > 1;
  $("#words").replaceChildren(...runs.map((run) => {
    const status = make("span", { className: `status ${run.status}`, textContent: run.status });
    const tiles = run.measured.map(({ what, norm, unit, value }) => make("div", { className: "tile" },
      make("span", { textContent: what }),
      make("b", {}, four(value), " ", make("small", { textContent: unit })),
      make("span", {}, ...indexed(norm))));
    return make("div", { className: "run" },
      make("h3", {}, ...(several ? [run.name] : []), status),
      make("p", { className: "lead", textContent: run.lead }),
      ...run.damage.map((damage) => make("p", { className: "damage", textContent: `Damaged: ${damage}` })),
      ...(tiles.length ? [make("div", { className: "tiles" }, ...tiles)] : []),
      ...(tiles.length && run === runs.at(-1) ? [make("p", { className: "about", textContent: "The largest errors of the last fifth. In the plots, drag to look closer, double click to see all again." })] : []));
  }));
}

function listGroups({ groups, figures }) {
  const bar = $("#groups");
  bar.hidden = !figures.length;
  if (bar.children.length === groups.length) return;
  bar.replaceChildren(...groups.map(({ name, ink }) => {
    const button = make("button", { type: "button", textContent: name, title: "click: hide or show; double click: alone" });
    button.dataset.group = name;
    if (ink !== null) button.style.setProperty("--mine", `var(--ink-${ink % 8})`);
    button.addEventListener("click", () => shown.turn(name, false));
    button.addEventListener("dblclick", () => shown.turn(name, true));
    return button;
  }));
}

function drawNetworks(runs) {
  $("#network").hidden = false;
  document.body.classList.toggle("several", runs.length > 1);
  $("#network .networks").replaceChildren(...runs.map(({ name, network }) =>
    make("figure", { innerHTML: network }, ...(runs.length > 1 ? [make("figcaption", { textContent: name })] : []))));
  if (runs.length > 1) return;
  for (const node of document.querySelectorAll(".node")) {
    const group = page.groups.find(({ name }) => name === nodeGroup(node.dataset.robot));
    if (group && group.ink !== null) node.style.setProperty("--mine", `var(--ink-${group.ink % 8})`);
  }
}

function table(caption, heads, rows) {
  const cell = (kind, value) => {
    const { text = value, name = "", number = false } = value !== null && typeof value === "object" ? value : {};
    return make(kind, { className: `${name}${number ? " number" : ""}`.trim() }, ...indexed(String(text)));
  };
  return make("div", { className: "scroll" }, make("table", {},
    ...(caption ? [make("caption", { textContent: caption })] : []),
    ...(heads.length ? [make("thead", {}, make("tr", {}, ...heads.map((head) => cell("th", head))))] : []),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((value) => cell("td", value)))))));
}
const number = (value, digits = 6) =>
  ({ text: value === null ? "∞" : Number(value.toPrecision(digits)).toString(), number: true });

const bounded = (value, atLeast) => {
  const { text } = number(value);
  return { text: `${atLeast ? ">" : "<"} ${text}`, number: true };
};

const mark = (status) => {
  const text = status === "violated" ? "fails" : status;
  return { text, name: text };
};

function tellTheory(runs) {
  const several = runs.length > 1;
  $("#theory").hidden = false;
  $("#theory .tables").replaceChildren(...runs.flatMap((run) => {
    const name = several ? `${run.name}: ` : "";
    const tables = [table(`${name}conditions`, ["", { text: "value", number: true }, { text: "bound", number: true }, "", "source"],
      [...run.conditions.map((v) => [v.name, number(v.value), v.status === "unknown" ? "" : bounded(v.bound, v.at_least),
        mark(v.status), v.source]),
       ...(run.spectral_radius === null ? [] : [["ρ", number(run.spectral_radius), bounded(1, false),
        mark(run.spectral_radius < 1 ? "holds" : "violated"),
        "left of the estimation error after a sampling period"]])])];
    const laws = [...new Set(run.measured.flatMap(({ bounds }) => Object.keys(bounds)))];
    if (laws.length)
      tables.push(table(`${name}steady state`, ["", { text: "measured", number: true }, ...laws.map((text) => ({ text, number: true }))],
        run.measured.map((m) => [`${m.norm} (${m.unit})`, number(m.value, 4),
          ...laws.map((law) => (law in m.bounds ? number(m.bounds[law], 4) : ""))])));
    return tables;
  }));
}

function tellNumbers(runs) {
  const several = runs.length > 1;
  $("#numbers").hidden = false;
  $("#numbers .tables").replaceChildren(...runs.flatMap((run) => {
    const name = several ? `${run.name}: ` : "";
    return [
      table(`${name}messages`, [], Object.entries(run.counted).map(([what, count]) => [what, { text: count, number: true }])),
      make("details", {}, make("summary", { textContent: `${name}made by` }),
        table("", [], Object.entries(run.particulars).map(([what, text]) => [what, { text, name: "long" }]))),
    ];
  }));
}

async function begin() {
  try { $("#theme").value = localStorage.getItem("nrs-theme") || "auto"; } catch { /* no memory here */ }
  $("#theme").addEventListener("change", () => {
    try { localStorage.setItem("nrs-theme", $("#theme").value); } catch { /* no memory here */ }
    theme.apply();
  });
  theme.wish.addEventListener("change", () => theme.apply());
  picture.begin();
  theme.apply();
  const data = JSON.parse($("#data").textContent);
  const library = inflated($("#plotly").textContent).then((source) => {
    document.head.append(make("script", { textContent: source }));
  });
  if (data) await render({ ...data, library });
  else await follow(library);
  document.documentElement.dataset.ready = "yes";
}

// A run that goes on is asked for what is new, a second after the last answer.
async function follow(library) {
  const told = $("#live");
  told.hidden = false;
  told.textContent = "Waiting for the run to begin …";
  let version = "";
  for (;;) {
    let answer;
    try { answer = await fetch(`data.json?since=${encodeURIComponent(version)}`); } catch {
      told.textContent = "The run is no longer served. This is what was recorded until then.";
      return;
    }
    if (answer.status === 200) {
      version = answer.headers.get("X-Version");
      const data = await answer.json();
      await render({ ...data, library });
      const [{ status }] = data.runs;
      told.textContent = status === "unfinished" ? "Live: the run goes on." : `Live: the run is ${status}.`;
      document.documentElement.dataset.ready = "yes";
      if (status !== "unfinished") return;
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}
