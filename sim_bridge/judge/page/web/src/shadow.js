// How far a radio reaches among trunks: each of them on the path leaves `factor` of the range (0..1).
const BEARINGS = 720;

// Outline about (east, north), ENU metres. Trunks are level circles; all stand higher than the vehicles.
export function reach(trees, east, north, range, factor) {
  const crossed = Array.from({ length: BEARINGS }, () => []);
  if (factor < 1) {
    for (let i = 0; i < trees.east_m.length; i++) {
      const dx = trees.east_m[i] - east;
      const dy = trees.north_m[i] - north;
      const away = Math.hypot(dx, dy);
      const radius = trees.radius_m[i];
      if (away - radius > range || away <= radius) continue;
      const half = (Math.asin(radius / away) * BEARINGS) / (2 * Math.PI);
      const middle = (Math.atan2(dx, dy) * BEARINGS) / (2 * Math.PI);
      const first = Math.ceil(middle - half);
      const last = Math.max(first, Math.floor(middle + half));
      for (let bin = first; bin <= last; bin++) crossed[(bin + 2 * BEARINGS) % BEARINGS].push(away);
    }
  }
  const outline = [];
  for (let bin = 0; bin < BEARINGS; bin++) {
    const far = farthest(crossed[bin], range, factor);
    const angle = (2 * Math.PI * bin) / BEARINGS;
    outline.push([east + far * Math.sin(angle), north + far * Math.cos(angle)]);
  }
  return outline;
}

function farthest(trunks, range, factor) {
  trunks.sort((a, b) => a - b);
  let left = range;
  for (const away of trunks) {
    if (left <= away) return left;
    left *= factor;
    if (left <= away) return away;
  }
  return left;
}
