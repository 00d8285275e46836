// A flight from above: of a replay, or under way.
import { MapCanvas } from "./canvas.js";
import { Chart } from "./chart.js";
import * as layers from "./layers/index.js";
import { Plane } from "./plane.js";
import { DESK } from "./style.js";
import { viewOf } from "./view.js";

// The lowest first.
export const FLIGHT_LAYERS = [
  layers.chart,
  layers.grid,
  layers.crowns,
  layers.trunks,
  layers.boxes,
  layers.fence,
  layers.areas,
  layers.coverage,
  layers.places,
  layers.ranges,
  layers.tracks,
  layers.trails,
  layers.links,
  layers.scans,
  layers.estimates,
  layers.against,
  layers.vehicles,
  layers.north,
  layers.scalebar,
];

const MARGIN = 0.06; // of a side, around all of it
const LEAST_M = 10;
const ROWS = 10; // every so many are looked at for what all of it is

export class FlightMap extends MapCanvas {
  // `shown`: name of a layer or of an option -> is it switched on
  constructor(canvas, replay, shown, picked) {
    super(canvas, FLIGHT_LAYERS, DESK, picked);
    Object.assign(this, { replay, shown, time: replay.start, fitted: false });
    const { fence_enu_m: fence, places, coverage } = replay.mission;
    this.plane = replay.mission.origin ? new Plane(...replay.mission.origin) : null;
    this.chart = replay.chart && this.plane ? new Chart(replay.chart, (tile) => (tile ? replay.chart.tiles[tile.join("/")] : replay.chart.image), () => this.draw()) : null;
    this.mission = { fence, places: places.map(({ name, enu_m: enu }) => ({ name, enu })), coverage };
  }

  show(time) {
    this.time = time;
    this.draw();
  }

  data() {
    const { replay, mission, time, chart, plane } = this;
    const shown = { ...this.shown, grid: chart === null };
    return { replay, mission, shown, time, chart, plane, against: replay.against ?? null, at: replay.time.length ? replay.at(time) : null };
  }

  whole() {
    this.fitted = this.replay.time.length > 0;
    const { mission, vehicles, against } = this.replay;
    const points = [];
    for (const one of [...vehicles, ...(against?.vehicles ?? [])]) for (let row = 0; row < one.east_m.length; row += ROWS) points.push([one.east_m[row], one.north_m[row]]);
    for (const { enu_m: at } of mission.places) points.push(at);
    const { centres_enu_m: centres, radius_m: radius } = mission.coverage;
    for (const [e, n] of centres) points.push([e - radius, n - radius], [e + radius, n + radius]);
    return viewOf(points, this.width, this.height, { least: LEAST_M, free: (px) => px * (1 - 2 * MARGIN) });
  }

  kept(last) {
    const { replay } = this;
    const view = this.fitted || this.steered || !replay.time.length ? super.kept(last) : this.whole(); // a flight has begun
    if (!this.shown.follow || !replay.time.length) return view;
    const at = replay.at(this.time);
    const seen = replay.followed(this.selected, at);
    if (!seen.length) return view;
    const mean = (axis) => seen.reduce((sum, position) => sum + position[axis], 0) / seen.length;
    return view.centred(mean(0), mean(1));
  }
}
