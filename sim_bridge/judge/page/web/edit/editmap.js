// The map that plans: what is clicked and dragged on it becomes a change of the mission.
import { MapCanvas } from "../src/map/canvas.js";
import { boxes, crowns, grid, north, scalebar } from "../src/map/layers/index.js";
import { DESK } from "../src/map/style.js";
import { viewOf } from "../src/map/view.js";
import * as layers from "./layers.js";
import { fenceOf, pointsOf, ringSpots, treesInTheWay } from "./plan.js";

// The lowest first.
export const EDIT_LAYERS = [
  grid,
  layers.contours,
  crowns,
  layers.stems,
  boxes,
  layers.noRoom,
  layers.radio,
  layers.start,
  layers.rings,
  layers.inTheWay,
  layers.fence,
  layers.route,
  layers.corners,
  layers.handles,
  layers.crosshair,
  layers.gridNumbers,
  scalebar,
  north,
];

const STYLE = { ...DESK, north: { x: 28, y: 36, sizePx: 11 } }; // in the corner: no tabs are there
const MARGIN = 0.06; // of a side, around all of it
const LEAST_M = 60;

export class EditMap extends MapCanvas {
  // `acts`: { placed, moved, chosen, removed, hovered }, what a reader does on the map.
  constructor(canvas, acts) {
    super(canvas, EDIT_LAYERS, STYLE, () => {});
    this.acts = acts;
    this.state = null;
    this.stand = null;
    this.tool = "move";
    this.shown = { radio: true, crowns: true };
    this.grabbed = null; // a handle under a finger
    this.held = null; // and where it is held, [east, north]
    this.aims = false;
    this.listenToHandles();
  }

  update(state, stand) {
    if (stand !== this.stand) this.drawn = null; // what stands still has changed
    const first = this.state === null || (stand?.trees.east_m.length > 0 && !this.stand?.trees.east_m.length);
    Object.assign(this, { state, stand });
    if (first && !this.steered) this.view = null;
    this.draw();
  }

  use(tool) {
    this.tool = tool;
    this.canvas.dataset.tool = tool;
    this.draw();
  }

  data() {
    const { state, stand, shown } = this;
    const room = this.tool === "d1" && !this.held ? (state?.start?.clear_m ?? null) : null;
    return { shown, stand, replay: stand, plan: state && this.plan(), room };
  }

  // Values as they are, but for what is held.
  plan() {
    const { state, stand, grabbed, held } = this;
    const { values, fields } = state;
    const move = (one) => (held && grabbed?.point === one.name ? { ...one, enu: [...held, one.enu?.[2] ?? 0] } : one);
    const points = pointsOf(values).map(move);
    const fence = fenceOf(values).map((at, k) => (held && grabbed?.corner === k ? held : at));
    const d1 = points[0].enu;
    return {
      points,
      fence,
      rings: ringsOf(points, fields),
      reaches: reachesOf(points, fields),
      start: d1 && state.start && { at: d1, radius: state.start.radius_m, clear: state.start.clear_m },
      blocking: stand && d1 && state.start ? treesInTheWay(stand.trees, d1, state.start.clear_m) : [],
      accused: this.accused ?? [],
      bad: this.bad ?? new Set(),
      comesBack: fields["route.at_end"] === "return",
      attenuation: state.attenuation,
      aims: this.aims && this.tool !== "move",
    };
  }

  whole() {
    const { state, stand } = this;
    const found = state ? [...pointsOf(state.values).map(({ enu }) => enu).filter(Boolean), ...fenceOf(state.values)] : [];
    const radius = state?.fields["coverage.radius_m"] ?? 0;
    const points = found.flatMap(([e, n]) => [[e - radius, n - radius], [e + radius, n + radius]]);
    const trees = stand?.trees.east_m ?? [];
    trees.forEach((east, i) => points.push([east, stand.trees.north_m[i]]));
    return viewOf(points.length ? points : [[0, 0]], this.width, this.height, { least: LEAST_M, free: (px) => px * (1 - 2 * MARGIN) });
  }

  // A tap: a point is placed, or a handle chosen.
  pick(px, py) {
    if (!this.state) return;
    const handle = this.handleAt(px, py);
    if (this.tool === "move" || handle?.corner !== undefined) this.acts.chosen(handle);
    else this.acts.placed(this.tool, this.view.enu(px, py));
  }

  handleAt(px, py) {
    const data = { plan: this.plan() };
    return layers.handles.hit(this.view, data, px, py) ?? layers.corners.hit(this.view, data, px, py);
  }

  drag(event) {
    if (!this.grabbed || this.pointers.size > 1) {
      super.drag(event);
      return;
    }
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    if (Math.hypot(event.offsetX - before[0], event.offsetY - before[1]) > 3) this.moved = true;
    if (!this.moved) return;
    this.held = this.view.enu(event.offsetX, event.offsetY);
    this.acts.hovered(this.held);
    this.draw();
  }

  listenToHandles() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      this.grabbed = this.state && this.pointers.size === 1 ? this.handleAt(event.offsetX, event.offsetY) : null;
      if (this.grabbed) this.acts.chosen(this.grabbed);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.view && !this.held) this.acts.hovered(this.view.enu(event.offsetX, event.offsetY));
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, () => {
        const { grabbed, held } = this;
        [this.grabbed, this.held] = [null, null];
        if (grabbed && held && kind === "pointerup") this.acts.moved(grabbed, held);
        else if (held) this.draw();
      });
    }
    canvas.addEventListener("keydown", (event) => this.key(event), { capture: true });
    for (const [kind, aims] of [["focus", true], ["blur", false]]) {
      canvas.addEventListener(kind, () => {
        this.aims = aims && canvas.matches(":focus-visible");
        this.draw();
      });
    }
  }

  key(event) {
    if (event.key === "Enter" && this.tool !== "move") this.acts.placed(this.tool, [this.view.east, this.view.north]);
    else if ((event.key === "Delete" || event.key === "Backspace") && this.selected) this.acts.removed(this.selected);
    else if (event.key === "Escape") this.acts.chosen(null);
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }
}

function ringsOf(points, fields) {
  const [radius, keepOut, size] = [fields["coverage.radius_m"], fields["coverage.keep_out_m"], fields["swarm.size"]];
  if (![radius, keepOut, size].every((one) => Number.isFinite(one) && one > 0)) return [];
  const known = points.filter(({ enu }) => enu);
  return known.flatMap(({ name, enu }, k) => (name === "d1" ? [] : [{ at: enu, radius, keepOut, spots: ringSpots(enu, radius, size, known[k - 1]?.enu) }]));
}

function reachesOf(points, fields) {
  const wanted = [[points[0].enu, fields["radio.transit_range_m"], "on the way"], [points.at(-1).enu, fields["radio.full_range_m"], "at d2"]];
  return wanted.filter(([at, range]) => at && Number.isFinite(range) && range > 0).map(([at, range, name]) => ({ at, range, name }));
}
