// Figures over time, tied to the replay's clock: a line follows it, and a click or a drag goes there.
import uPlot from "uplot";
import { colours, vehicleColour } from "./theme.js";
import { el } from "./dom.js";
import { resampled } from "./compare.js";
import { upTo } from "./replay.js";

const HEIGHT_PX = 104;
const CROWD = 30; // vehicles
const MARKED = ["fault", "lead", "contact"];

const number = (digits, unit) => (value) => (Number.isNaN(value) ? "none" : `${value.toFixed(digits)}${unit}`);
const each = (name) => (replay) => (replay.vehicles.some((one) => one[name]) ? replay.vehicles.map((one) => one[name]) : null);
const swarm = (name) => (replay) => (replay.grows || replay.swarm[name].some((value) => !Number.isNaN(value)) ? [replay.swarm[name]] : null);
const known = (values) => values.filter((value) => !Number.isNaN(value));
const lowest = (values) => (known(values).length ? Math.min(...known(values)) : NaN);
const highest = (values) => (known(values).length ? Math.max(...known(values)) : NaN);

// `of`: a column, or one for each vehicle. `say`: which of them is told in words.
const PANELS = [
  { name: "least separation", of: swarm("separation_m"), told: number(1, " m"), limit: (replay) => replay.mission.separation_hard_m },
  { name: "links", of: swarm("links"), told: number(0, ""), stepped: true },
  { name: "algebraic connectivity λ₂", of: swarm("lambda2"), told: number(2, "") },
  { name: "leader's distance to go", of: swarm("to_go_m"), told: number(0, " m") },
  { name: "coverage gap", of: swarm("gap_deg"), told: number(0, "°") },
  { name: "battery, lowest", of: each("battery_pct"), told: number(0, " %"), say: lowest },
  { name: "age of the last beacon, oldest", of: each("beacon_age_s"), told: number(1, " s"), say: highest, least: 1 },
];

export class Plots {
  constructor(root, replay, clock) {
    this.replay = replay;
    this.clock = clock;
    const { against } = replay;
    this.time = against && against.end > replay.end ? against.time : replay.time; // of all columns
    this.panels = PANELS.map((panel) => ({ ...panel, data: replay.time.length || replay.grows ? this.data(panel) : null }))
      .filter(({ data }) => data)
      .map((panel) => this.make(panel, root));
    new ResizeObserver(() => this.resize()).observe(root);
  }

  // Its columns. Of a crowd that is drawn over and over again only what is told in words.
  data(panel) {
    if (this.replay.against) return this.both(panel);
    const columns = panel.of(this.replay);
    if (!columns || !panel.say || !this.replay.grows || columns.length <= CROWD) return columns;
    return [this.replay.time.map((_, row) => panel.say(columns.map((column) => column[row])))];
  }

  // Of A and B, a column each.
  both(panel) {
    const flights = [this.replay, this.replay.against];
    const found = flights.map((flight) => {
      const columns = panel.of(flight);
      if (!columns) return null;
      const one = columns.length > 1 ? flight.time.map((_, row) => panel.say(columns.map((column) => column?.[row] ?? NaN))) : columns[0];
      return resampled(one, flight.time, this.time);
    });
    return found.every((column) => column === null) ? null : found;
  }

  // Of the line at an index.
  colour(k, many) {
    if (this.replay.against) return k ? colours().warn : colours().accent;
    return many ? vehicleColour(k) : colours().accent;
  }

  drawn(data) {
    return [this.time, ...data.map((column) => Array.from(column ?? [], (v) => (Number.isNaN(v) ? null : v)))];
  }

  // There are more rows.
  grew() {
    for (const panel of this.panels) {
      panel.data = this.data(panel);
      panel.chart.setData(this.drawn(panel.data));
    }
  }

  make(panel, root) {
    const value = el("output", { class: "now" });
    const cursor = el("div", { class: "cursor" });
    const holder = el("figure", { class: "plot" }, el("figcaption", {}, el("span", {}, panel.name), value));
    root.append(holder);
    const many = panel.data.length > 1;
    const axis = { stroke: () => colours().muted, grid: { stroke: () => colours().grid, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const series = panel.data.map((_, k) => ({
      stroke: () => this.colour(k, many),
      width: many && !this.replay.against ? 1 : 1.6,
      dash: this.replay.against && k ? [6, 4] : undefined,
      points: { show: false },
      paths: panel.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined,
    }));
    const limit = panel.limit?.(this.replay);
    const chart = new uPlot(
      {
        width: Math.max(200, holder.clientWidth || 320),
        height: HEIGHT_PX,
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low ?? 0), Math.max(panel.least ?? 1e-3, (high ?? 1) * 1.08, limit ?? 0)] } },
        axes: [{ ...axis, size: 22, space: 60, values: (_, ticks) => ticks.map((tick) => `${tick} s`) }, { ...axis, size: 42, space: 28 }],
        series: [{}, ...series],
        hooks: { drawAxes: [(made) => this.drawMarks(made, limit)] },
      },
      this.drawn(panel.data),
      holder,
    );
    chart.over.append(cursor);
    this.seekable(chart);
    return { ...panel, chart, cursor, value, holder };
  }

  seekable(chart) {
    const go = (event) => {
      const box = chart.over.getBoundingClientRect();
      this.clock.seek(chart.posToVal(event.clientX - box.left, "x"));
    };
    chart.over.addEventListener("pointerdown", (event) => {
      chart.over.setPointerCapture(event.pointerId);
      go(event);
    });
    chart.over.addEventListener("pointermove", (event) => event.buttons && go(event));
  }

  drawMarks(chart, limit) {
    const pen = chart.ctx;
    const ink = colours();
    const { left, top, width, height } = chart.bbox;
    pen.save();
    pen.lineWidth = devicePixelRatio;
    for (const { time_s: at, kind } of this.replay.events) {
      if (!MARKED.includes(kind)) continue;
      const x = chart.valToPos(at, "x", true);
      pen.strokeStyle = kind === "lead" ? ink.leader : ink.alarm;
      pen.setLineDash(kind === "lead" ? [] : [3, 3]);
      pen.beginPath();
      pen.moveTo(x, top);
      pen.lineTo(x, top + height);
      pen.stroke();
    }
    if (limit !== undefined) {
      const y = chart.valToPos(limit, "y", true);
      pen.strokeStyle = ink.alarm;
      pen.setLineDash([6, 4]);
      pen.beginPath();
      pen.moveTo(left, y);
      pen.lineTo(left + width, y);
      pen.stroke();
    }
    pen.restore();
  }

  show(time) {
    const row = Math.max(0, upTo(this.time, time) - 1);
    for (const { chart, cursor, value, data, told, say } of this.panels) {
      cursor.style.transform = `translateX(${chart.valToPos(time, "x")}px)`;
      const values = data.map((column) => column?.[row] ?? NaN);
      if (this.replay.against) value.value = values.map((one, k) => `${"AB"[k]} ${told(one)}`).join(" · ");
      else value.value = told(say ? say(values) : values[0]);
    }
  }

  resize() {
    for (const { chart, holder } of this.panels) {
      const width = Math.floor(holder.clientWidth);
      if (width && width !== chart.width) chart.setSize({ width, height: HEIGHT_PX });
    }
    this.show(this.clock.time);
  }

  redraw() {
    for (const { chart } of this.panels) chart.redraw(false, true);
  }
}
