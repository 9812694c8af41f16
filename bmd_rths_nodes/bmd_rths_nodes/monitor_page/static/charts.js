// What uPlot is told to draw. Every chart is a function of a view; nothing is drawn by hand.

const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const FLOORS = ["blue", "red", "green", "orange", "pink", "sky", "brown", "grey"];
const SYNCHRONISED = 2; // seconds of the synchronisation plot

function axis(options = {}) {
  return {
    stroke: colour("soft"), grid: { stroke: colour("grid"), width: 1 }, ticks: { show: false },
    font: `${0.85 * rem()}px system-ui, sans-serif`, gap: 0.25 * rem(), size: 1.35 * rem(), space: 3.2 * rem(), ...options,
  };
}
const upright = (options = {}) => axis({ size: 2.9 * rem(), space: 1.9 * rem(), ...options });
const line = (label, name, options = {}) => ({
  label, stroke: colour(name), width: 0.11 * rem(), points: { show: false }, spanGaps: false, ...options,
});
const times = (u) => u.times ?? [0, 1];
const legend = () => ({ show: true, live: false, markers: { width: 0, fill: (u, i) => u.series[i].stroke(u, i) } });
const symmetric = (u, low, high) => {
  const top = 1.1 * Math.max(Math.abs(low ?? 0), Math.abs(high ?? 0), 1e-3);
  return [-top, top];
};

// A sensor is read at the end of its step, where the next step begins.
const ends = (column) => [null, ...column.slice(0, -1)];
const scaled = (column, factor) => column.map((value) => (value === null ? null : factor * value));

/** The charts that exist while a run with so many floors is shown. */
function definitions(floors) {
  const byTime = { legend: legend(), scales: { x: { time: false, range: times }, y: { range: symmetric } }, axes: [axis(), upright()] };
  return {
    acceleration: {
      ...byTime,
      series: [{}, line("ground", "grey"), line("command", "green", { width: 0.08 * rem() }), line("achieved", "red"), line("desired", "blue", { width: 0.15 * rem() })],
      data: (v) => [v.x, v.at("ground_acceleration"), v.at("command"), v.at("table_acceleration", ends), v.at("desired_acceleration")],
    },
    floors: {
      ...byTime,
      series: [{}, ...Array.from({ length: floors }, (_, i) => line(`${i + 1}`, FLOORS[i % FLOORS.length]))],
      data: (v) => [v.x, ...v.floors().map(ends)],
    },
    forces: {
      ...byTime,
      series: [{}, line("actuator", "grey", { width: 0.07 * rem() }), line("required", "orange", { width: 0.24 * rem() }), line("estimated shear", "green", { width: 0.16 * rem() }), line("fed back", "blue", { width: 0.08 * rem() })],
      data: (v) => [v.x, ...[["actuator_force", ends], ["required_force"], ["interface_force", ends], ["corrected_force", ends]].map(([name, shift]) => scaled(v.at(name, shift), 1e-3))],
    },
    synchronisation: {
      legend: { show: false },
      scales: { x: { time: false, range: (u) => u.reach ?? [-1, 1] }, y: { range: (u) => u.reach ?? [-1, 1] } },
      axes: [axis(), upright()],
      series: [{}, line("the same", "grey", { width: 0.08 * rem(), spanGaps: true }), line("achieved", "red", { paths: () => null, points: { show: true, size: 0.28 * rem(), fill: colour("red"), width: 0 } })],
      data: (v) => synchronised(v),
      before: (u, data) => { u.reach = [data[0][0], data[0].at(-1)]; },
    },
    tracking: {
      legend: legend(),
      scales: { x: { time: false, range: times }, ms: { range: symmetric }, "%": { range: (u, low, high) => [0, 1.15 * Math.max(high ?? 0, 1)] } },
      axes: [axis(), upright({ scale: "%" }), upright({ scale: "ms", side: 1, grid: { show: false } })],
      series: [{}, line("error %", "red", { scale: "%" }), line("delay ms", "blue", { scale: "ms" })],
      data: (v) => [v.view.tracking.end, v.view.tracking.error_percent, v.view.tracking.delay_ms],
    },
    stability: {
      legend: legend(),
      scales: { x: { time: false, range: times }, y: { range: (u, low, high) => [0, 1.15 * Math.max(high ?? 0, 1e-3)] } },
      axes: [axis(), upright()],
      series: [{}, line("limit", "red", { dash: [6, 4] }), line("indicator", "blue", { points: { show: true, size: 0.28 * rem(), fill: colour("blue") } })],
      data: (v) => [v.view.stability.time, v.view.stability.time.map(() => v.view.limits.at(-1).limit), v.view.stability.value],
    },
    closure: {
      legend: legend(),
      scales: { x: { time: false, range: (u, low, high) => [0, high ?? 1] }, y: { distr: 3, range: (u, low, high) => [0.6, 2 * Math.max(high ?? 1, 10)] } },
      axes: [axis(), upright({ values: (u, splits) => splits.map((n) => (Number.isInteger(Math.log10(n)) ? `${n}` : "")), grid: { show: false } })],
      series: [{}, bars("in time", "blue"), bars("late", "red")],
      data: (v) => histogram(v.view.closure),
    },
  };
}

const bars = (label, name) => line(label, name, { fill: colour(name), width: 0, paths: uPlot.paths.bars({ size: [1, Infinity], align: 1 }) });

function synchronised(v) {
  const first = Math.max(0, v.x.length - 1 - Math.round(SYNCHRONISED / v.dt));
  const desired = v.at("desired_acceleration"), achieved = v.at("table_acceleration");
  const pairs = [];
  for (let k = first; k + 1 < v.x.length; k += 1) {
    if (desired[k + 1] !== null && achieved[k] !== null) pairs.push([desired[k + 1], achieved[k]]);
  }
  pairs.sort((one, other) => one[0] - other[0]);
  const top = 1.1 * Math.max(1e-3, ...pairs.flat().map(Math.abs)); // the line reaches from corner to corner
  const x = [-top, ...pairs.map((pair) => pair[0]), top];
  return [x, [-top, ...pairs.map(() => null), top], [null, ...pairs.map((pair) => pair[1]), null]];
}

/** Steps by their closure; those that were late stand in two parts behind the deadline. */
function histogram({ edges_ms, counts, late, deadline_ms }) {
  const width = deadline_ms / Math.max(counts.length, 1), none = edges_ms.map(() => null);
  const x = [...edges_ms, deadline_ms, deadline_ms + width, deadline_ms + 2 * width];
  return [x, [...counts.map((count) => count || null), null, null, null], [...none, late || null, late || null, null]];
}

/** Why a chart cannot be drawn, if it cannot. */
function missing(name, { closure, stability, tracking }) {
  if (name === "closure") return closure.why;
  if (name === "tracking" && tracking.end.length === 0) return "no window of 2 s with enough motion";
  return name === "stability" && stability.time.length === 0 ? "nothing was told of it in this time" : undefined;
}

/** All charts of the page, made again when size of letters, theme or number of floors change. */
export class Charts {
  constructor() {
    this.plots = {};
    this.made = "";
  }

  draw(v) {
    const wanted = `${v.floors().length} ${rem()} ${document.documentElement.dataset.theme}`;
    if (wanted !== this.made) this.make(v.floors().length, wanted);
    for (const [name, definition] of Object.entries(this.definitions)) this.drawOne(name, definition, v);
  }

  make(floors, wanted) {
    for (const plot of Object.values(this.plots)) plot.destroy();
    this.plots = {};
    this.definitions = definitions(floors);
    this.made = wanted;
  }

  drawOne(name, definition, v) {
    const place = document.getElementById(name);
    const why = missing(name, v.view);
    place.classList.toggle("why", why !== undefined);
    if (why !== undefined) {
      this.plots[name]?.destroy();
      delete this.plots[name];
      place.textContent = why;
      return;
    }
    const size = { width: place.clientWidth, height: place.clientHeight };
    const data = definition.data(v);
    let plot = this.plots[name];
    if (plot === undefined) {
      place.textContent = "";
      const { data: _, before: __, ...options } = definition;
      plot = new uPlot({ ...size, ...options, cursor: { show: false }, padding: [0.5 * rem(), 0.6 * rem(), 0, 0] }, [[], ...options.series.slice(1).map(() => [])], place);
      this.plots[name] = plot;
    }
    if (plot.width !== size.width || plot.height !== size.height) plot.setSize(size);
    plot.times = v.times;
    definition.before?.(plot, data);
    plot.setData(data);
  }
}

/** The ground motion of the whole test, behind the time bar. */
export class Overview {
  constructor(place) {
    this.place = place;
  }

  draw([time, ground], duration, [begin, end]) {
    const size = { width: this.place.clientWidth, height: this.place.clientHeight };
    const theme = document.documentElement.dataset.theme;
    if (this.plot === undefined || this.theme !== theme) {
      this.plot?.destroy();
      this.theme = theme;
      this.plot = new uPlot({
        ...size, legend: { show: false }, cursor: { show: false }, padding: [0, 0, 0, 0],
        scales: { x: { time: false, range: () => [0, this.duration] }, y: { range: symmetric } },
        axes: [{ show: false }, { show: false }], series: [{}, line("ground", "grey", { width: 1 })],
      }, [[], []], this.place);
    }
    this.duration = Math.max(duration, 1e-3);
    if (this.plot.width !== size.width || this.plot.height !== size.height) this.plot.setSize(size);
    this.plot.setData([time, ground]);
    const left = (size.width * Math.max(begin, 0)) / this.duration;
    this.plot.setSelect({ left, top: 0, width: (size.width * end) / this.duration - left, height: size.height }, false);
  }
}
