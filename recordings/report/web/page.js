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
// "left_elbow_joint" may go on in the next line after each "_"
const breakable = (text) => text.split(/(?<=_)/).flatMap((part, at) => (at ? [make("wbr", {}), part] : part));
const wrapped = (text) => indexed(text).flatMap((part) => (typeof part === "string" ? breakable(part) : part));

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
const nodeGroup = (robot) => (robot === "0" ? "target" : page.runs[0].groups[page.runs[0].robots.indexOf(Number(robot))]);

let page = null; // what is shown now

function render(data) {
  page = data;
  page.arrays = decoded(data.arrays);
  const names = data.runs.map(({ name }) => name);
  document.title = `${names.join(", ")} – nrs report`;
  $("#title").textContent = names.join(" and ");
  sayWords(data);
  listGroups(data);
  drawNetworks(data.runs);
  tellTheory(data.runs);
  tellNumbers(data.runs);
  picture.take(data);
  links.take(data.runs);
  shown.tell();
  return plots.take(data);
}

const four = (number) => Number(number.toPrecision(4)).toString();

const marks = { within: "✓", exceeded: "✗", transient: "~", unproven: "?", "not measured": "–" };
const verdict = (status) => make("em", { className: `verdict ${status}`, textContent: `${marks[status]} ${status}` });

function sayWords({ runs, differences, live }) {
  const several = runs.length > 1;
  const shared = several ? runs[0].lead.filter((sentence) => runs.every(({ lead }) => lead.includes(sentence))) : [];
  const told = runs.map((run) => {
    const going = live && run.status === "unfinished";
    const status = make("span", { className: `status ${run.status}`, textContent: going ? "running" : run.status });
    const tiles = run.measured.map(({ what, norm, unit, value, status, bounds }) => make("div", { className: "tile" },
      make("span", { textContent: what }),
      make("b", {}, four(value), " ", make("small", { textContent: unit })),
      make("span", {}, ...indexed(norm)),
      make("span", {}, verdict(status), ...Object.entries(bounds).slice(0, 1).map(([law, bound]) => ` ${law} ${four(bound)}`))));
    const lead = run.lead.filter((sentence) => !shared.includes(sentence)).join(" ");
    return make("div", { className: "run" },
      make("h3", {}, ...(several ? [make("i", { className: "ink" }), run.name, make("small", { textContent: `${run.file}.mcap` })] : []), status),
      make("p", { className: "lead" }, ...breakable(lead)),
      ...run.damage.map((damage) => make("p", { className: "damage", textContent: `Damaged: ${damage}` })),
      ...(tiles.length ? [make("div", { className: "tiles" }, ...tiles)] : []));
  });
  if (several) told.forEach((run, at) => run.style.setProperty("--mine", `var(--ink-${at % 8})`));
  const names = runs.map(({ name }) => name);
  $("#words").replaceChildren(
    ...(shared.length ? [make("p", { className: "lead", textContent: shared.join(" ") })] : []),
    ...(several ? [make("section", { id: "differences" }, make("h2", { textContent: "What differs" }), differences.length
      ? table("", ["", ...names], differences.map((row) => [row.key, ...names.map((name) => row[name])]))
      : make("p", { textContent: "Nothing: the scenarios are the same." }))] : []),
    ...told,
    ...(runs.some(({ measured }) => measured.length) ? [make("p", { className: "about", textContent: "The largest errors of the last fifth, and whether they are within what is proven. In the plots, drag to look closer, double click to see all again." })] : []));
}

function listGroups({ groups, figures }) {
  const bar = $("#groups");
  bar.hidden = !figures.length;
  const listed = JSON.stringify(groups);
  if (bar.dataset.listed === listed) return;
  bar.dataset.listed = listed;
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

function table(caption, heads, rows, className = "scroll") {
  const cell = (kind, value, head = "") => {
    const { text = value, name = "", number = false } = value !== null && typeof value === "object" ? value : {};
    const made = make(kind, { className: `${name}${number ? " number" : ""}`.trim() }, ...wrapped(String(text)));
    if (head) made.dataset.head = head;
    return made;
  };
  return make("div", { className }, make("table", {},
    ...(caption ? [make("caption", { textContent: caption })] : []),
    ...(heads.length ? [make("thead", {}, make("tr", {}, ...heads.map((head) => cell("th", head))))] : []),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((value, at) => cell("td", value, heads[at]?.text ?? heads[at])))))));
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
  const found = runs.flatMap((run) => {
    const name = several ? `${run.name}: ` : "";
    const conditions = [...run.conditions.map((v) => [v.name, mark(v.status), number(v.value), v.status === "unknown" ? "" : bounded(v.bound, v.at_least),
      { text: v.source, name: "source" }]),
    ...(run.spectral_radius === null ? [] : [["ρ", mark(run.spectral_radius < 1 ? "holds" : "violated"),
      number(run.spectral_radius), bounded(1, false),
      { text: "left of the estimation error after a sampling period", name: "source" }]])];
    const tables = conditions.length ? [table(`${name}conditions`, ["", "", { text: "value", number: true }, { text: "bound", number: true }, "source"], conditions)] : [];
    const laws = [...new Set(run.measured.flatMap(({ bounds }) => Object.keys(bounds)))];
    if (laws.length)
      tables.push(table(`${name}steady state`, ["", "", { text: "measured", number: true }, ...laws.map((text) => ({ text, number: true }))],
        run.measured.map((m) => [{ text: `${m.norm} (${m.unit})`, name: "norm" }, mark(m.status), number(m.value, 4),
          ...laws.map((law) => (law in m.bounds ? number(m.bounds[law], 4) : ""))])));
    return run.gains ? [...tables, make("figure", { innerHTML: run.gains })] : tables;
  });
  $("#theory").hidden = !found.length;
  $("#theory .tables").replaceChildren(...found);
}

function tellNumbers(runs) {
  const several = runs.length > 1;
  $("#numbers").hidden = false;
  $("#numbers .tables").replaceChildren(...runs.flatMap((run) => {
    const name = several ? `${run.name}: ` : "";
    const [first] = run.plants, [joints, ...saturated] = run.saturated;
    return [
      ...(first ? [table(`${name}plants`, Object.keys(first),
        run.plants.map((plant) => Object.entries(plant).map(([what, text]) => (what === "SHA-256" ? { text: text.slice(0, 16), name: "long" } : { text, name: ["joints", "controller"].includes(what) ? "named" : "" }))), "scroll wide stacked")] : []),
      ...(joints ? [table(`${name}torques at their limits, in parts of a robot’s states`, joints.map((text, at) => ({ text, number: at > 0 })),
        saturated.map((row) => row.map((text, at) => ({ text, number: at > 0 }))), joints.length > 5 ? "scroll wide" : "scroll")] : []),
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
  links.begin();
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
  const told = $("#told");
  $("#live").hidden = false;
  told.textContent = "Waiting for the run to begin …";
  plots.window = Number($("#window").value);
  $("#window").addEventListener("change", () => { plots.window = Number($("#window").value); plots.recolour(); });
  let version = "", first = null;
  for (;;) {
    let answer;
    try { answer = await fetch(`data.json?since=${encodeURIComponent(version)}`); } catch {
      told.textContent = "The run is no longer served. This is what was recorded until then.";
      $("#left").textContent = "";
      return;
    }
    if (answer.status === 200) {
      version = answer.headers.get("X-Version");
      const data = await answer.json();
      const [run] = data.runs, at = { clock: performance.now() / 1000, seconds: run.seconds };
      first ??= at;
      const going = run.status === "unfinished";
      told.textContent = going ? "Live: the run goes on." : `Live: the run is ${run.status}.`;
      $("#progress").max = run.planned;
      $("#progress").value = run.ticks;
      const pace = (at.seconds - first.seconds) / (at.clock - first.clock);
      const left = going && pace > 0 ? `, about ${duration((run.planned_seconds - run.seconds) / pace)} left` : "";
      $("#left").textContent = `${four(run.seconds)} of ${four(run.planned_seconds)} s simulated${left}`;
      await render({ ...data, library });  // its words come at once, its plots take longer
      document.documentElement.dataset.ready = "yes";
      if (!going) return;
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}

const duration = (s) => (s < 90 ? `${Math.ceil(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`);
