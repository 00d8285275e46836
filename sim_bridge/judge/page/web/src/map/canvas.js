// The one map canvas of all pages: its view, its layers, and what a reader does to it. A page's own class says what data there are.
import { colours } from "../theme.js";
import { checked } from "./layer.js";
import { View } from "./view.js";

const ZOOM_KEY = 1.25;
const PAN_PX = 60;
const DRAG_PX = 2; // less is a tap
const APART_PX = 8; // of two fingers, at least

export class MapCanvas {
  // `layers`: from the lowest to the uppermost; `style`: of map/style.js; `picked`: called with what `hit` of a layer found, or null.
  constructor(canvas, layers, style, picked) {
    this.canvas = canvas;
    this.layers = [];
    for (const layer of layers) this.register(layer);
    this.style = style;
    this.picked = picked;
    this.selected = null;
    this.view = null;
    this.steered = false; // by a reader: a window of another size keeps what it shows
    this.pointers = new Map();
    this.moved = false;
    [this.width, this.height] = [0, 0]; // px; asked for when they change, as a browser works out its layout for an answer
    new ResizeObserver(() => this.resized()).observe(canvas);
    this.listen();
  }

  // For a page's own class: what layers draw (map/layer.js says which keys there are) ...
  data() {
    return {};
  }

  // ... a view of all there is, and the view to draw, which may follow what moves; `view`: the last one, or null.
  whole() {
    throw new Error("a page's map says what all of it is");
  }

  kept(view) {
    return view ?? this.whole();
  }

  // On top of the others.
  register(layer) {
    if (this.layers.some(({ name }) => name === layer.name)) throw new Error(`layer ${layer.name}: there is one of this name`);
    this.layers.push(checked(layer));
  }

  resized() {
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.view = this.steered && this.view ? new View(this.view, this.width, this.height) : null;
    this.draw();
  }

  draw() {
    const { canvas } = this;
    if (!this.width || !this.height) return;
    const ratio = window.devicePixelRatio || 1;
    const [wide, high] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
    this.view = this.kept(this.view);
    const ctx = canvas.getContext("2d");
    const shared = { ink: colours(), style: this.style, selected: this.selected, ...this.data() };
    const shown = this.layers.filter((layer) => isShown(layer, shared));
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.drawImage(this.background(shown.filter(({ still }) => still), shared, wide, high, ratio), 0, 0);
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    const data = { ...shared, labels: this.style.labels?.(ctx, this.view, shared.ink) };
    for (const layer of shown) if (!layer.still) this.drawLayer(layer, ctx, data);
  }

  drawLayer(layer, ctx, data) {
    ctx.save();
    Object.assign(ctx, this.style.pen);
    layer.draw(ctx, this.view, data);
    ctx.restore();
  }

  // What stands still: drawn when the view changes, and not for each frame.
  background(layers, data, wide, high, ratio) {
    const { east, north, scale } = this.view;
    const key = [wide, high, east, north, scale, data.chart?.loaded, ...layers.map(({ name }) => name)].join();
    if (this.drawn?.key === key && this.drawn.ink === data.ink) return this.drawn.canvas;
    const canvas = this.drawn?.canvas ?? document.createElement("canvas");
    [canvas.width, canvas.height] = [wide, high];
    this.drawn = { canvas, key, ink: data.ink };
    const ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.fillStyle = data.ink.ground;
    ctx.fillRect(0, 0, this.width, this.height);
    for (const layer of layers) this.drawLayer(layer, ctx, data);
    return canvas;
  }

  x(east) {
    return this.view.x(east);
  }

  y(north) {
    return this.view.y(north);
  }

  fit() {
    this.steered = false;
    this.view = this.whole();
    this.draw();
  }

  // A reader wants it so.
  steer(view) {
    this.steered = true;
    this.view = view;
    this.draw();
  }

  zoom(factor, px, py) {
    this.steer(this.view.zoomed(factor, px, py));
  }

  pan(dx, dy) {
    this.steer(this.view.panned(dx, dy));
  }

  pick(px, py) {
    const data = { style: this.style, selected: this.selected, ...this.data() };
    let found = null;
    for (const layer of this.layers.toReversed()) {
      if (layer.hit && isShown(layer, data)) found ??= layer.hit(this.view, data, px, py);
    }
    this.picked(found);
  }

  listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
      this.moved = false;
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => {
        if (kind === "pointerup" && !this.moved && pointers.size === 1) this.pick(event.offsetX, event.offsetY);
        pointers.delete(event.pointerId);
      });
    }
    canvas.addEventListener("keydown", (event) => {
      const pans = { ArrowLeft: [PAN_PX, 0], ArrowRight: [-PAN_PX, 0], ArrowUp: [0, PAN_PX], ArrowDown: [0, -PAN_PX] };
      if (pans[event.key]) this.pan(...pans[event.key]);
      else if (event.key === "+" || event.key === "=") this.zoom(ZOOM_KEY);
      else if (event.key === "-") this.zoom(1 / ZOOM_KEY);
      else if (event.key === "0") this.fit();
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  drag(event) {
    const { pointers } = this;
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    if (Math.hypot(now[0] - before[0], now[1] - before[1]) > DRAG_PX) this.moved = true;
    if (pointers.size === 1 && this.moved) this.pan(now[0] - before[0], now[1] - before[1]);
    if (pointers.size === 2) {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const apart = (at) => Math.max(APART_PX, Math.hypot(at[0] - other[0], at[1] - other[1]));
      this.zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    }
    if (pointers.size > 1 || this.moved) pointers.set(event.pointerId, now);
  }
}

// Its data are there, and nobody has switched it off.
function isShown({ name, needs }, data) {
  return data.shown?.[name] !== false && needs.every((key) => data[key] !== null && data[key] !== undefined);
}
