// What one picture of `companion watch` says of a vehicle.
export const FRESH_S = 2; // as companion/watch/heard.py

// As it reports, or, without satellites, as it estimates from its leader; latitude and longitude, or null.
export const positionOf = (one) => one.place ?? one.reckoned ?? null;

export const leads = (one) => one.acting && one.leader === one.id;

export function age(seconds) {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  return seconds < 100 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}

// Ages go on while no picture comes.
export function aged(picture, since_s) {
  const older = (one) => ({ ...one, age_s: one.age_s + since_s });
  return { ...picture, vehicles: picture.vehicles.map(older), told: picture.told.map(older) };
}

// In a line.
export function summaryOf({ vehicles, silence_s: silence }, since_s) {
  const fresh = vehicles.filter((one) => one.age_s < FRESH_S);
  if (!fresh.length) return silence === null ? "Nothing heard yet" : `Nothing heard for ${age(silence + since_s)}`;
  const leaders = [...new Set(fresh.filter((one) => one.acting).map((one) => one.leader))];
  const phases = [...new Set(fresh.map((one) => one.phase))];
  const silent = vehicles.length - fresh.length;
  return [
    leaders.length ? `Leader ${leaders.join(" and ")}` : "No leader",
    phases.join(", "),
    `${fresh.length} heard${silent ? `, ${silent} silent` : ""}`,
  ].join(" · ");
}
