// From latitude and longitude to metres east and north of a place, on the plane that touches the ellipsoid there.
const AXIS_M = 6378137;
const ECCENTRICITY_2 = 6.69437999014e-3;
const RAD = Math.PI / 180;

export class Plane {
  constructor(lat, lon) {
    this.lat = lat;
    this.lon = lon;
    const w = 1 - ECCENTRICITY_2 * Math.sin(lat * RAD) ** 2;
    this.north = (AXIS_M * (1 - ECCENTRICITY_2)) / w ** 1.5;
    this.east = (AXIS_M / Math.sqrt(w)) * Math.cos(lat * RAD);
  }

  enu([lat, lon]) {
    const turn = ((((lon - this.lon + 180) % 360) + 360) % 360) - 180;
    return [turn * RAD * this.east, (lat - this.lat) * RAD * this.north];
  }

  wgs84([east, north]) {
    return [this.lat + north / this.north / RAD, this.lon + east / this.east / RAD];
  }
}

// Web Mercator's tiles, y from the north.
export function tileAt([lat, lon], zoom) {
  const side = 2 ** zoom;
  const bounded = Math.max(-85.05, Math.min(85.05, lat)) * RAD;
  return [((lon + 180) / 360) * side, ((1 - Math.asinh(Math.tan(bounded)) / Math.PI) / 2) * side];
}

export function cornerOf(x, y, zoom) {
  const side = 2 ** zoom;
  return [Math.atan(Math.sinh(Math.PI * (1 - (2 * y) / side))) / RAD, (x / side) * 360 - 180];
}
