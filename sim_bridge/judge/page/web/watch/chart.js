// What lies under the vehicles: tiles or one image, from the computer that watches. None of it: a grid.
import { cornerOf, tileAt } from "./place.js";

const KEPT = 160; // tiles
const SHOWN = 80; // in one view; with more, coarser ones
const MERCATOR_M = 156543.034; // for a pixel of a tile of 256, zoom 0, at the equator

export class Chart {
  constructor(about, changed) {
    this.about = about;
    this.changed = changed;
    this.tiles = new Map();
    if (about.corners_deg) this.whole = this.load("/map/image");
  }

  load(url) {
    const image = new Image();
    image.onload = () => this.changed();
    image.src = url;
    return image;
  }

  draw(pen, map, plane) {
    if (this.whole) this.drawImage(pen, map, plane);
    else this.drawTiles(pen, map, plane);
  }

  drawImage(pen, map, plane) {
    const { whole, about } = this;
    if (!whole.complete || !whole.naturalWidth) return;
    const [a, b, c] = about.corners_deg.map((corner) => plane.enu(corner)).map(([e, n]) => [map.x(e), map.y(n)]);
    const [w, h] = about.size_px;
    pen.save();
    pen.transform((b[0] - a[0]) / w, (b[1] - a[1]) / w, (c[0] - a[0]) / h, (c[1] - a[1]) / h, a[0], a[1]);
    pen.drawImage(whole, 0, 0, w, h);
    pen.restore();
  }

  drawTiles(pen, map, plane) {
    const { about } = this;
    const wanted = Math.log2(MERCATOR_M * Math.cos((plane.lat * Math.PI) / 180) * map.view.scale);
    let zoom = Math.max(about.min_zoom, Math.min(about.max_zoom, Math.round(wanted)));
    const half = [map.width / 2 / map.view.scale, map.height / 2 / map.view.scale];
    const ends = [1, -1].map((side) => plane.wgs84([map.view.east - side * half[0], map.view.north + side * half[1]]));
    let low;
    let high;
    for (; ; zoom -= 1) {
      [low, high] = ends.map((place) => tileAt(place, zoom).map(Math.floor));
      if (zoom <= about.min_zoom || (high[0] - low[0] + 1) * (high[1] - low[1] + 1) <= SHOWN) break;
    }
    if ((high[0] - low[0] + 1) * (high[1] - low[1] + 1) > SHOWN) return; // further out than the map has tiles for
    for (let x = low[0]; x <= high[0]; x += 1) for (let y = low[1]; y <= high[1]; y += 1) this.drawTile(pen, map, plane, zoom, x, y);
  }

  drawTile(pen, map, plane, zoom, x, y) {
    const key = `/map/${zoom}/${x}/${y}`;
    let tile = this.tiles.get(key);
    if (tile) this.tiles.delete(key); // and in again behind the others: the oldest goes first
    else tile = this.load(key);
    this.tiles.set(key, tile);
    if (this.tiles.size > KEPT) this.tiles.delete(this.tiles.keys().next().value);
    if (!tile.complete || !tile.naturalWidth) return;
    const [left, top] = plane.enu(cornerOf(x, y, zoom));
    const [right, bottom] = plane.enu(cornerOf(x + 1, y + 1, zoom));
    pen.drawImage(tile, map.x(left), map.y(top), map.x(right) - map.x(left) + 0.5, map.y(bottom) - map.y(top) + 0.5);
  }
}
