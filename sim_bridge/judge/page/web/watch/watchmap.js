// Where vehicles of the watched swarm report to be, or reported when they were last heard.
import { MapCanvas } from "../src/map/canvas.js";
import { Chart } from "../src/map/chart.js";
import * as layers from "../src/map/layers/index.js";
import { Plane } from "../src/map/plane.js";
import { FIELD } from "../src/map/style.js";
import { View, viewOf } from "../src/map/view.js";
import { positionOf } from "./picture.js";

// The lowest first.
export const WATCH_LAYERS = [
  layers.chart,
  layers.grid,
  layers.fence,
  layers.places,
  layers.following,
  layers.peerreports,
  layers.heard,
  layers.north,
  layers.scalebar,
];

const EDGE_PX = 30; // a vehicle that is nearer to the edge than this is followed
const MARGIN_PX = 110; // of both sides, around all of it
const SIDE_MIN_PX = 60;
const LEAST_M = 20;
const SCALE_MOST = 30; // px a metre

export class WatchMap extends MapCanvas {
  constructor(canvas, picked) {
    super(canvas, WATCH_LAYERS, FIELD, picked);
    this.plane = null;
    this.chart = null;
    this.picture = null;
    this.followed = true; // until somebody moves the map
    this.fitted = false;
  }

  update(picture) {
    this.picture = picture;
    const { about, vehicles } = picture;
    const first = about.mission?.places[0].at ?? vehicles.map(positionOf).find(Boolean) ?? middle(about.chart);
    if (!this.plane && first) this.plane = new Plane(first[0], first[1]);
    if (!this.chart && about.chart && this.plane) this.chart = new Chart(about.chart, addressOf, () => this.draw());
    this.draw();
  }

  data() {
    const { plane, chart } = this;
    const shown = { grid: plane !== null && chart === null, scalebar: plane !== null };
    if (!plane) return { shown };
    const enu = (at) => at && plane.enu(at);
    const { about, vehicles, told } = this.picture;
    return {
      shown,
      plane,
      chart,
      mission: about.mission && {
        fence: about.mission.fence.map(enu),
        places: about.mission.places.map(({ name, at }) => ({ name, enu: enu(at) })),
      },
      vehicles: vehicles.map((one) => ({ ...one, enu: enu(positionOf(one)) })),
      peerReports: told.map((one) => ({ ...one, enu: enu(one.place) })),
    };
  }

  steer(view) {
    this.followed = false;
    super.steer(view);
  }

  // Of the vehicles, and of those that others report.
  positions() {
    const { vehicles, peerReports } = this.data();
    return [...vehicles, ...peerReports].map(({ enu }) => enu).filter(Boolean);
  }

  whole() {
    if (!this.plane) return this.viewOf([]);
    const { mission } = this.data();
    return this.viewOf([...this.positions(), ...(mission ? [...mission.places.map(({ enu }) => enu), ...mission.fence] : [])]);
  }

  viewOf(points) {
    this.fitted = points.length > 0;
    if (!points.length) return new View({ east: 0, north: 0, scale: 2 }, this.width, this.height);
    const free = (px) => Math.max(SIDE_MIN_PX, px - MARGIN_PX);
    return viewOf(points, this.width, this.height, { least: LEAST_M, free, most: SCALE_MOST });
  }

  kept(view) {
    if (!this.followed || !this.plane) return super.kept(view);
    return view && this.fitted && this.holds(view) ? view : this.viewOf(this.positions());
  }

  holds(view) {
    return this.positions().every(([e, n]) => {
      const [x, y] = [view.x(e), view.y(n)];
      return x > EDGE_PX && y > EDGE_PX && x < this.width - EDGE_PX && y < this.height - EDGE_PX;
    });
  }

  follow() {
    this.followed = true;
    if (this.plane) this.view = this.viewOf(this.positions());
    this.draw();
  }

  fit() {
    this.followed = false;
    super.fit();
  }
}

// Of a tile, or of the whole map where there are no tiles; from the computer that watches.
const addressOf = (tile) => (tile ? `/map/${tile.join("/")}` : "/map/image");

function middle(chart) {
  if (chart?.corners_deg) return chart.corners_deg[0];
  const [west, south, east, north] = chart?.bounds_deg ?? [];
  return west === undefined ? null : [(south + north) / 2, (west + east) / 2];
}
