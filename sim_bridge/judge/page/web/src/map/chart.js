// What lies under the vehicles: tiles or one image.
import { cornerOf, tileAt } from "./plane.js";

const KEPT = 160; // tiles
const SHOWN = 80; // in one view; with more, coarser ones
const MERCATOR_M = 156543.034; // for a pixel of a tile of 256, zoom 0, at the equator

export class Chart {
  // `addressOf([zoom, x, y])`: of a tile, or undefined: there is none; `addressOf()`: of the one image.
  constructor(about, addressOf, changed) {
    this.about = about;
    this.addressOf = addressOf;
    this.changed = changed;
    this.tiles = new Map();
    this.loaded = 0; // pictures
    if (about.corners_deg) this.whole = this.load(addressOf());
  }

  load(url) {
    const image = new Image();
    image.onload = () => {
      this.loaded += 1;
      this.changed();
    };
    image.src = url;
    return image;
  }

  draw(ctx, view, plane) {
    if (this.whole) this.drawImage(ctx, view, plane);
    else this.drawTiles(ctx, view, plane);
  }

  drawImage(ctx, view, plane) {
    const { whole, about } = this;
    if (!whole.complete || !whole.naturalWidth) return;
    const [a, b, c] = about.corners_deg.map((corner) => plane.enu(corner)).map(([e, n]) => [view.x(e), view.y(n)]);
    const [w, h] = about.size_px;
    ctx.save();
    ctx.transform((b[0] - a[0]) / w, (b[1] - a[1]) / w, (c[0] - a[0]) / h, (c[1] - a[1]) / h, a[0], a[1]);
    ctx.drawImage(whole, 0, 0, w, h);
    ctx.restore();
  }

  drawTiles(ctx, view, plane) {
    const { about } = this;
    const wanted = Math.log2(MERCATOR_M * Math.cos((plane.lat * Math.PI) / 180) * view.scale);
    let zoom = Math.max(about.min_zoom, Math.min(about.max_zoom, Math.round(wanted)));
    const ends = [view.enu(0, 0), view.enu(view.width, view.height)].map((at) => plane.wgs84(at));
    let low;
    let high;
    for (; ; zoom -= 1) {
      [low, high] = ends.map((place) => tileAt(place, zoom).map(Math.floor));
      if (zoom <= about.min_zoom || (high[0] - low[0] + 1) * (high[1] - low[1] + 1) <= SHOWN) break;
    }
    if ((high[0] - low[0] + 1) * (high[1] - low[1] + 1) > SHOWN) return; // further out than the map has tiles for
    for (let x = low[0]; x <= high[0]; x += 1) for (let y = low[1]; y <= high[1]; y += 1) this.drawTile(ctx, view, plane, zoom, x, y);
  }

  drawTile(ctx, view, plane, zoom, x, y) {
    const key = `${zoom}/${x}/${y}`;
    let tile = this.tiles.get(key);
    if (tile) this.tiles.delete(key); // and in again behind the others: the oldest goes first
    else {
      const address = this.addressOf([zoom, x, y]);
      if (!address) return;
      tile = this.load(address);
    }
    this.tiles.set(key, tile);
    if (this.tiles.size > KEPT) this.tiles.delete(this.tiles.keys().next().value);
    if (!tile.complete || !tile.naturalWidth) return;
    const [left, top] = plane.enu(cornerOf(x, y, zoom));
    const [right, bottom] = plane.enu(cornerOf(x + 1, y + 1, zoom));
    ctx.drawImage(tile, view.x(left), view.y(top), view.x(right) - view.x(left) + 0.5, view.y(bottom) - view.y(top) + 0.5);
  }
}
