// From ENU metres to a canvas's CSS pixels, north up: a frozen value.
const SCALE_MIN = 0.02; // px a metre
const SCALE_MAX = 400;

export class View {
  // `east`, `north`: metres in the middle; `scale`: px a metre; `width`, `height`: px.
  constructor({ east, north, scale }, width, height) {
    Object.assign(this, { east, north, scale, width, height });
    Object.freeze(this);
  }

  x(east) {
    return this.width / 2 + (east - this.east) * this.scale;
  }

  y(north) {
    return this.height / 2 - (north - this.north) * this.scale;
  }

  // East and north at a pixel.
  enu(px, py) {
    return [this.east + (px - this.width / 2) / this.scale, this.north - (py - this.height / 2) / this.scale];
  }

  // What lies under (px, py) stays there.
  zoomed(factor, px = this.width / 2, py = this.height / 2) {
    const scale = Math.min(SCALE_MAX, Math.max(SCALE_MIN, this.scale * factor));
    const kept = 1 / this.scale - 1 / scale;
    const [east, north] = [this.east + (px - this.width / 2) * kept, this.north - (py - this.height / 2) * kept];
    return new View({ east, north, scale }, this.width, this.height);
  }

  panned(dx, dy) {
    return this.centred(this.east - dx / this.scale, this.north + dy / this.scale);
  }

  centred(east, north) {
    return new View({ east, north, scale: this.scale }, this.width, this.height);
  }

  // The largest round number of metres (1, 2, 5, 10 ...) of about so many pixels.
  roundMetres(wantedPx) {
    const wanted = wantedPx / this.scale;
    const power = 10 ** Math.floor(Math.log10(wanted));
    return power * [1, 2, 5, 10].find((step) => step * power >= wanted * 0.99);
  }

  // Of [east, north] positions, the index of the nearest to a pixel that is less than `reachPx` away; null: none, and none of null.
  nearest(positions, px, py, reachPx) {
    let [best, least] = [null, reachPx];
    positions.forEach((at, k) => {
      if (!at) return;
      const away = Math.hypot(this.x(at[0]) - px, this.y(at[1]) - py);
      if (away < least) [best, least] = [k, away];
    });
    return best;
  }
}

// West, south, east and north of [east, north] positions.
export function bounds(points) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [e, n] of points) {
    if (e < box[0]) box[0] = e;
    if (n < box[1]) box[1] = n;
    if (e > box[2]) box[2] = e;
    if (n > box[3]) box[3] = n;
  }
  return box;
}

// A view of all points. `least`: metres that are shown at any rate; `free(px)`: of a side, how much may be used; `most`: px a metre.
export function viewOf(points, width, height, { least, free, most = SCALE_MAX }) {
  const [west, south, east, north] = bounds(points);
  const scale = Math.min(most, free(width) / Math.max(least, east - west), free(height) / Math.max(least, north - south));
  return new View({ east: (west + east) / 2, north: (south + north) / 2, scale }, width, height);
}
