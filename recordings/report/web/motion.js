// The moving picture: arms as their links, robots without links as points, on two canvases.

const picture = {
  runs: [], end: 0, now: 0, playing: false, before: 0,
  following: true, // of a run that goes on: whether the newest time is shown

  begin() {
    $("#play").addEventListener("click", () => this.turn(!this.playing));
    $("#slider").addEventListener("input", () => {
      this.turn(false);
      this.set(Number($("#slider").value));
      this.following = this.now >= this.end;
    });
    new ResizeObserver(() => this.draw()).observe($("#motion"));
  },

  take({ runs, groups, arrays, live }) {
    this.runs = runs.filter(({ motion }) => motion).map((run) => {
      const motion = run.motion;
      const t = arrays[motion.t], q = arrays[motion.q], m = q.length / t.length / run.robots.length;
      const points = motion.points.map((number) => arrays[number]);
      const target_figure = { parents: motion.target_parents, points: arrays[motion.target_points] };
      return { t, q, m, robots: run.robots, known: motion.known, target_figure,
        figures: motion.parents.map((parents, row) => ({ parents, points: points[row] })),
        estimates: arrays[motion.estimates], target: arrays[motion.target], unit: run.unit,
        groups: run.groups };
    });
    for (const run of this.runs)
      run.inks = run.groups.map((name) => groups.find((group) => group.name === name).ink);
    $("#motion").hidden = !this.runs.length;
    if (!this.runs.length) return;
    this.end = Math.max(...this.runs.map(({ t }) => t[t.length - 1]));
    $("#slider").max = this.end || 1;
    const all = this.runs.flatMap(({ figures }) => figures);
    const chains = all.some(({ parents }) => parents.length), points = all.some(({ parents }) => !parents.length);
    this.far = 0;
    for (const { points } of all)
      for (const along of points || []) if (Math.abs(along) > this.far) this.far = Math.abs(along);
    $("#jointspace").hidden = !chains || this.runs.every(({ m }) => m < 2);
    const unknown = this.runs.some(({ known }) => !known);
    $("#workspace figcaption").textContent = !chains ? `the plane (${this.runs[0].unit}); rings are estimates; the picture goes with the target, the cross`
      : `the arms${unknown ? ", drawn with links of unit length," : ""} on one base; the broad grey arm is the target’s position`;
    this.reach = { chains, points };
    this.sides = this.zoom();
    this.set(live && this.following && !this.playing ? this.end : this.now);
  },

  // how far from the target joint space is seen at each frame of the first run: as far as the
  // farthest robot is within a second, so that nothing leaves and nothing jumps
  zoom() {
    const [first] = this.runs, frames = [...first.t];
    const far = frames.map((t) => {
      const middle = this.at(first, first.target, 0, 1, t);
      let most = 0;
      for (const run of this.runs)
        run.robots.forEach((_, row) => {
          const q = this.at(run, run.q, row, run.robots.length, t);
          for (const axis of [0, Math.min(1, run.m - 1)])
            if (Math.abs(q[axis] - middle[axis]) > most) most = Math.abs(q[axis] - middle[axis]);
        });
      return Math.max(most * 1.2, 1);
    });
    const near = (values, at, fold) => {
      const wide = Math.max(Math.round(1 / Math.max(frames[1] - frames[0], 1e-9)) || 1, 1);
      return fold(values.slice(Math.max(at - wide, 0), at + wide + 1));
    };
    const most = far.map((_, at) => near(far, at, (some) => Math.max(...some)));
    return most.map((_, at) => near(most, at, (some) => some.reduce((a, b) => a + b, 0) / some.length));
  },

  turn(on) {
    this.playing = on;
    $("#play").textContent = on ? "❚❚" : "▶";
    $("#play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return;
    this.following = false;
    if (this.now >= this.end) this.now = 0;
    this.before = performance.now();
    requestAnimationFrame(() => this.step());
  },

  step() {
    if (!this.playing) return;
    const clock = performance.now();
    this.set(this.now + (clock - this.before) / 1000 * Number($("#speed").value));
    this.before = clock;
    if (this.now >= this.end) this.turn(false);
    else requestAnimationFrame(() => this.step());
  },

  set(t) {
    this.now = Math.min(Math.max(t, 0), this.end);
    $("#slider").value = this.now;
    $("#now").textContent = `${this.now.toFixed(2)} s`;
    links.show();
    this.draw();
  },

  // the values of one row of a run's array at a time, between its frames
  at(run, array, row, rows, t, width = run.m) {
    const times = run.t;
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const part = high > low ? Math.min(Math.max((t - times[low]) / (times[high] - times[low]), 0), 1) : 0;
    const values = [];
    for (let axis = 0; axis < width; axis++) {
      const from = array[(low * rows + row) * width + axis], to = array[(high * rows + row) * width + axis];
      values.push(from + (to - from) * part);
    }
    return values;
  },

  draw() {
    if (!this.runs.length) return;
    for (const [id, paint] of [["workspace", this.reach.chains ? "arms" : "plane"], ["jointspace", "plane"]]) {
      const canvas = $(`#${id} canvas`);
      const side = canvas.clientWidth;
      if (!side) continue;
      const dense = devicePixelRatio || 1;
      canvas.width = canvas.height = Math.round(side * dense);
      const brush = canvas.getContext("2d");
      brush.scale(dense, dense);
      brush.lineCap = brush.lineJoin = "round";
      this[paint](brush, side);
    }
  },

  grid(brush, side, middle, half) {
    brush.strokeStyle = theme.colour("--line");
    brush.fillStyle = theme.colour("--soft");
    brush.font = `16px ${getComputedStyle(document.body).fontFamily}`;
    brush.lineWidth = 1;
    const rough = half / 3, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].find((factor) => factor * power >= rough) * power;
    const scale = side / 2 / half;
    const text = (value) => Number(value.toPrecision(6)).toString();
    for (let x = Math.ceil((middle[0] - half) / step) * step; x <= middle[0] + half; x += step) {
      const at = side / 2 + (x - middle[0]) * scale;
      brush.beginPath(); brush.moveTo(at, 0); brush.lineTo(at, side); brush.stroke();
      if (at < side - 30) brush.fillText(text(Math.round(x / step) * step), at + 3, side - 5);
    }
    for (let y = Math.ceil((middle[1] - half) / step) * step; y <= middle[1] + half; y += step) {
      const at = side / 2 - (y - middle[1]) * scale;
      brush.beginPath(); brush.moveTo(0, at); brush.lineTo(side, at); brush.stroke();
      if (at < side - 28 && at > 18) brush.fillText(text(Math.round(y / step) * step), 3, at - 3);
    }
    return ([x, y]) => [side / 2 + (x - middle[0]) * scale, side / 2 - (y - middle[1]) * scale];
  },

  // where the points of a robot's links are on the canvas at a time
  places(run, figure, t, to) {
    const flat = this.at(run, figure.points, 0, 1, t, 2 * (figure.parents.length + 1));
    return [...Array(flat.length / 2).keys()].map((at) => to([flat[2 * at], flat[2 * at + 1]]));
  },

  limbs(brush, places, { parents }) {
    if (places.flat().some(Number.isNaN)) return;
    brush.beginPath(); // one for all, so that nothing is darker where they meet
    parents.forEach((parent, at) => { brush.moveTo(...places[parent]); brush.lineTo(...places[at + 1]); });
    brush.stroke();
  },

  line(brush, points) {
    if (points.flat().some(Number.isNaN)) return;
    brush.beginPath();
    points.forEach(([x, y], at) => (at ? brush.lineTo(x, y) : brush.moveTo(x, y)));
    brush.stroke();
  },

  dot(brush, [x, y], radius, fill) {
    if (Number.isNaN(x + y)) return;
    brush.beginPath(); brush.arc(x, y, radius, 0, 2 * Math.PI);
    if (fill) brush.fill(); else brush.stroke();
  },

  trail(place) { // of the last second and a half
    const points = [];
    for (let past = 45; past >= 0; past--) {
      const t = this.now - past / 30;
      if (t >= 0) points.push(place(t));
    }
    return points;
  },

  // the first of several runs is seen behind the others, where they coincide
  wide(at) { return this.runs.length > 1 && at === 0 ? 1.8 : 1; },

  arms(brush, side) {
    const to = this.grid(brush, side, [0, 0], this.far * 1.12);
    for (const [at, run] of this.runs.entries()) {
      if (run.target_figure.points && shown.has("target") && at === 0) {
        brush.strokeStyle = brush.fillStyle = theme.colour("--ink");
        brush.globalAlpha = 0.22;
        brush.lineWidth = 16;
        this.limbs(brush, this.places(run, run.target_figure, this.now, to), run.target_figure);
        brush.globalAlpha = 1;
      }
      run.figures.forEach((figure, row) => {
        if (!figure.points || !shown.has(run.groups[row])) return;
        brush.strokeStyle = brush.fillStyle = theme.ink(run.inks[row]);
        brush.globalAlpha = 0.35;
        brush.lineWidth = 1.5;
        this.line(brush, this.trail((t) => this.places(run, figure, t, to).at(-1)));
        brush.globalAlpha = 0.92;
        const wide = this.wide(at);
        brush.lineWidth = 4 * wide;
        const places = this.places(run, figure, this.now, to);
        this.limbs(brush, places, figure);
        places.slice(1).forEach((place) => this.dot(brush, place, 5 * wide, true));
        brush.globalAlpha = 1;
      });
    }
    brush.fillStyle = theme.colour("--ink");
    this.dot(brush, to([0, 0]), 6, true);
  },

  plane(brush, side) {
    const [first] = this.runs;
    const middle = this.at(first, first.target, 0, 1, this.now).map((x) => (Number.isFinite(x) ? x : 0));
    const frame = Math.round(this.now / (first.t[first.t.length - 1] || 1) * (first.t.length - 1));
    const half = this.sides[Math.min(frame, this.sides.length - 1)];
    const to = this.grid(brush, side, [middle[0], middle[1] ?? 0], half);
    const two = (values) => to([values[0], values[1] ?? 0]);
    this.runs.forEach((run, at) => {
      run.robots.forEach((_, row) => {
        if (!shown.has(run.groups[row])) return;
        brush.strokeStyle = brush.fillStyle = theme.ink(run.inks[row]);
        brush.globalAlpha = 0.5;
        brush.lineWidth = 1.5;
        this.line(brush, this.trail((t) => two(this.at(run, run.q, row, run.robots.length, t))));
        brush.globalAlpha = 1;
        brush.lineWidth = 2;
        this.dot(brush, two(this.at(run, run.estimates, row, run.robots.length, this.now)), 8 * this.wide(at), false);
        this.dot(brush, two(this.at(run, run.q, row, run.robots.length, this.now)), 5 * this.wide(at), true);
      });
      if (at === 0 && shown.has("target")) {
        brush.strokeStyle = theme.colour("--ink");
        brush.lineWidth = 2.5;
        const [x, y] = two(this.at(run, run.target, 0, 1, this.now));
        this.line(brush, [[x - 10, y], [x + 10, y]]);
        this.line(brush, [[x, y - 10], [x, y + 10]]);
      }
    });
  },
};

// Which links are shown of a network that changes: all, those of a phase, or of the time shown.
const links = {
  begin() { $("#phase").addEventListener("change", () => this.show()); },

  take(runs) {
    const most = Math.max(...runs.map(({ phases }) => phases));
    $("#phases").hidden = most < 2;
    if ($("#phase").children.length !== most + 2)
      $("#phase").replaceChildren(new Option("at the time shown", "now"), new Option("of all phases", "all"),
        ...[...Array(most).keys()].map((phase) => new Option(`of phase ${phase + 1} of ${most}`, phase)));
    this.show();
  },

  show() {
    if (!page) return;
    const chosen = $("#phase").value;
    document.querySelectorAll("#network figure").forEach((figure, at) => {
      const { turns, phases } = page.runs[at];
      if (phases < 2) return;
      const phase = chosen === "now" ? turns.which[turns.t.findLastIndex((t) => t <= picture.now)] : Number(chosen);
      for (const link of figure.querySelectorAll("[data-phases]"))
        link.classList.toggle("absent", chosen !== "all" && !link.dataset.phases.split(" ").includes(`${phase}`));
      if (at === 0) $("#turn").textContent = chosen === "now" ? `phase ${phase + 1} of ${phases}` : "";
    });
  },
};

begin();
