// A canvas that shows ENU metres: dragged, zoomed, pinched, or steered with the arrow keys. Who extends it draws.
const MARGIN = 0.06;
const ZOOM_KEY = 1.25;
const PAN_PX = 60;

export class MapView {
  constructor(canvas, replay, layers, picked) {
    this.canvas = canvas;
    this.replay = replay;
    this.layers = layers; // name -> shown
    this.picked = picked; // called with the index of a vehicle, or null
    this.selected = null;
    this.time = replay.start;
    this.view = null;
    this.steered = false; // by a reader: a window of another size keeps what it shows
    this.pointers = new Map();
    this.moved = false;
    [this.width, this.height] = [0, 0]; // px; asked for when they change, as a browser works out its layout for an answer
    new ResizeObserver(() => {
      [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
      if (!this.steered) this.view = null;
      this.draw();
    }).observe(canvas);
    this.listen();
  }

  show(time) {
    this.time = time;
    this.draw();
  }

  // The whole flight, north up.
  fit() {
    this.steered = false;
    const { vehicles, mission } = this.replay;
    const east = [];
    const north = [];
    for (const one of vehicles) {
      for (let row = 0; row < one.east_m.length; row += 10) {
        east.push(one.east_m[row]);
        north.push(one.north_m[row]);
      }
    }
    for (const { enu_m: at } of mission.places) {
      east.push(at[0]);
      north.push(at[1]);
    }
    for (const at of mission.coverage.centres_enu_m) {
      for (const sign of [-1, 1]) {
        east.push(at[0] + sign * mission.coverage.radius_m);
        north.push(at[1] + sign * mission.coverage.radius_m);
      }
    }
    const ends = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
    const [west, eastmost] = ends(east);
    const [south, northmost] = ends(north);
    const width = Math.max(10, eastmost - west);
    const height = Math.max(10, northmost - south);
    const room = 1 - 2 * MARGIN;
    const scale = Math.min((this.width * room) / width, (this.height * room) / height);
    this.view = { east: (west + eastmost) / 2, north: (south + northmost) / 2, scale };
  }

  x(east) {
    return this.width / 2 + (east - this.view.east) * this.view.scale;
  }

  y(north) {
    return this.height / 2 - (north - this.view.north) * this.view.scale;
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(400, Math.max(0.02, this.view.scale * factor));
    const kept = 1 / this.view.scale - 1 / scale;
    this.view.east += (px - this.width / 2) * kept;
    this.view.north -= (py - this.height / 2) * kept;
    this.view.scale = scale;
    this.steered = true;
    this.draw();
  }

  pan(dx, dy) {
    this.view.east -= dx / this.view.scale;
    this.view.north += dy / this.view.scale;
    this.steered = true;
    this.draw();
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
      else if (event.key === "0") {
        this.fit();
        this.draw();
      } else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  drag(event) {
    const { pointers } = this;
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    if (Math.hypot(now[0] - before[0], now[1] - before[1]) > 2) this.moved = true;
    if (pointers.size === 1 && this.moved) this.pan(now[0] - before[0], now[1] - before[1]);
    if (pointers.size === 2) {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const apart = (at) => Math.max(8, Math.hypot(at[0] - other[0], at[1] - other[1]));
      this.zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    }
    if (pointers.size > 1 || this.moved) pointers.set(event.pointerId, now);
  }

  pick(px, py) {
    const at = this.replay.at(this.time);
    let best = null;
    let least = 22;
    this.replay.vehicles.forEach((_, k) => {
      const [east, north] = this.replay.place(k, at);
      const away = Math.hypot(this.x(east) - px, this.y(north) - py);
      if (away < least) [best, least] = [k, away];
    });
    this.picked(best);
  }
}
