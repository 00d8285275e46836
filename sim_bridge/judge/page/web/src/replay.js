// The document of docs/reference/replay.md, unpacked: typed arrays over rows, and lookups by time.

export async function unpack(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Response(stream).json();
}

function column(coded) {
  const sums = Float64Array.from(coded.is);
  for (let order = coded.order; order > 0; order--) for (let i = 1; i < sums.length; i++) sums[i] += sums[i - 1];
  for (let i = 0; i < sums.length; i++) sums[i] *= coded.step;
  const gaps = coded.gaps ?? [];
  for (let i = 0; i < gaps.length; i += 2) sums.fill(NaN, gaps[i], gaps[i] + gaps[i + 1]);
  return sums;
}

function steps(coded, length) {
  const values = new Float64Array(length);
  let row = 0;
  coded.rows.forEach((delta, i) => {
    row += delta;
    values.fill(coded.is[i] * coded.step, row);
  });
  return values;
}

function running(deltas) {
  let sum = 0;
  return deltas.map((delta) => (sum += delta));
}

function columns(table) {
  return Object.fromEntries(Object.entries(table).map(([name, coded]) => [name, column(coded)]));
}

// How many of the rising numbers are at most `value`.
export function upTo(sorted, value) {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low;
}

const STEPS = ["alive", "on_ground", "armed", "acting", "touched", "leader", "phase", "range_m"];

function vehicle(coded, rows) {
  const one = { id: coded.id };
  for (const name of ["east_m", "north_m", "up_m"]) one[name] = column(coded[name]);
  for (const name of STEPS) one[name] = steps(coded[name], rows);
  for (const name of ["yaw_deg", "battery_pct", "beacon_age_s"]) one[name] = coded[name] ? column(coded[name]) : null;
  one.estimate_off = coded.estimate_off ? columns(coded.estimate_off) : null;
  one.scans = coded.scans ? { ...coded.scans, rows: running(coded.scans.rows) } : null;
  return one;
}

export class Replay {
  constructor(doc) {
    Object.assign(this, {
      title: doc.title,
      madeBy: doc.made_by,
      seed: doc.seed,
      verdict: doc.verdict,
      limits: doc.limits,
      figures: doc.figures_named ?? Object.entries(doc.figures), // by their keys in replays of 0.2
      mission: doc.mission,
      attenuationFactor: doc.mission.trunk_attenuation_factor ?? doc.mission.kept_per_trunk, // its name until 0.2
      missionToml: doc.mission_toml,
      needs: doc.needs ?? "", // nothing in replays of 0.2
      events: doc.events,
      byVehicle: doc.by_vehicle ?? [], // none of a flight under way, nor in replays of 0.2
      chart: doc.chart ?? null,
      standReport: doc.stand_report ?? null,
    });
    this.time = column(doc.time_s);
    const rows = this.time.length;
    this.vehicles = doc.vehicles.map((coded) => vehicle(coded, rows));
    this.trees = columns(doc.stand.trees);
    this.bushes = columns(doc.stand.bushes);
    this.boxes = doc.stand.boxes_enu_m ?? []; // none in replays of 0.2
    const { leader, phase, ...over } = doc.swarm;
    this.swarm = { leader: steps(leader, rows), phase: steps(phase, rows), ...columns(over) };
    this.pairs = doc.links.map(([a, b, ...changes]) => ({ a: a - 1, b: b - 1, changes: running(changes) }));
    this.swarm.links = this.countLinks(rows);
  }

  // How many rows there may be.
  get room() {
    return this.time.length;
  }

  get start() {
    return this.time[0] ?? 0;
  }

  get end() {
    return this.time[this.time.length - 1] ?? 0;
  }

  countLinks(rows) {
    const change = new Float64Array(rows + 1);
    for (const { changes } of this.pairs) changes.forEach((row, i) => (change[row] += i % 2 ? -1 : 1));
    for (let i = 1; i < rows; i++) change[i] += change[i - 1];
    return change.slice(0, rows);
  }

  // The row at or before `time`, and how far on it is to the next, 0..1.
  at(time) {
    const row = Math.max(0, upTo(this.time, time) - 1);
    if (row >= this.time.length - 1) return { row, share: 0 };
    return { row, share: Math.min(1, Math.max(0, (time - this.time[row]) / (this.time[row + 1] - this.time[row]))) };
  }

  // East, north, up of the vehicle at index `k`.
  place(k, { row, share }) {
    const one = this.vehicles[k];
    const next = share > 0 ? row + 1 : row;
    return ["east_m", "north_m", "up_m"].map((axis) => one[axis][row] + share * (one[axis][next] - one[axis][row]));
  }

  // Places that a view follows: of the vehicle at index `k`, or of all whose companions are alive where it is null.
  followed(k, at) {
    if (k !== null) return [this.place(k, at)];
    return this.vehicles.flatMap((one, index) => (one.alive[at.row] ? [this.place(index, at)] : []));
  }

  // Pairs of indices that are linked in `row`.
  linksAt(row) {
    return this.pairs.filter(({ changes }) => upTo(changes, row) % 2 === 1);
  }

  // Points of the vehicle's last scan, ENU metres level, and how old it is in rows; null: none.
  scanAt(k, row) {
    const { scans, yaw_deg: yaw, east_m: east, north_m: north } = this.vehicles[k];
    if (!scans) return null;
    const index = upTo(scans.rows, row) - 1;
    if (index < 0) return null;
    const then = scans.rows[index];
    const heading = yaw ? yaw[then] : 0;
    const points = [];
    for (let sector = 0; sector < scans.sectors; sector++) {
      const range = scans.ranges_dm[index * scans.sectors + sector] / 10;
      if (range <= 0) continue;
      const angle = ((heading + scans.start_deg + sector * scans.step_deg) * Math.PI) / 180;
      points.push([east[then] + range * Math.sin(angle), north[then] + range * Math.cos(angle)]);
    }
    return { points, age: row - then };
  }
}

export const SCAN_ROWS = 12; // a scan that is older is not shown
export const PHASES = ["assemble", "gather", "transit", "coverage", "return", "land"];
