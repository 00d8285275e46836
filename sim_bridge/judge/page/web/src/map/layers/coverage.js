// The largest gap between the vehicles on the ring, while they cover it.
import { PHASES } from "../../replay.js";

const ON_RING = 0.5; // of the radius: nearer to the centre a vehicle is still on its way

export const coverage = {
  name: "coverage",
  needs: ["replay", "at"],
  legend: { text: "coverage", order: 7, shown: true },

  draw(ctx, view, { ink, replay, at }) {
    const ring = replay.mission.coverage;
    if (PHASES[replay.swarm.phase[at.row]] !== "coverage" || ring.shape !== "ring") return;
    const [e0, n0] = ring.centres_enu_m.at(-1);
    const bearings = replay.vehicles
      .map((one, k) => ({ flies: one.alive[at.row] && !one.on_ground[at.row], place: replay.place(k, at) }))
      .filter(({ flies, place }) => flies && Math.hypot(place[0] - e0, place[1] - n0) > ring.radius_m * ON_RING)
      .map(({ place }) => Math.atan2(place[1] - n0, place[0] - e0));
    const gap = largestGap(bearings);
    if (!gap) return;
    const [x, y, radius] = [view.x(e0), view.y(n0), ring.radius_m * view.scale];
    ctx.strokeStyle = ink.warn;
    ctx.lineWidth = 4;
    ctx.globalAlpha = 0.7;
    ctx.beginPath();
    ctx.arc(x, y, radius, -gap.from, -(gap.from + gap.size), true);
    ctx.stroke();
    ctx.globalAlpha = 1;
    const middle = gap.from + gap.size / 2;
    ctx.fillStyle = ink.ink;
    ctx.textAlign = "center";
    const far = radius + 18;
    ctx.fillText(`gap ${Math.round((gap.size * 180) / Math.PI)}°`, x + far * Math.cos(middle), y - far * Math.sin(middle));
  },
};

// Of angles, radians: where it starts and its size; null with less than two.
export function largestGap(angles) {
  if (angles.length < 2) return null;
  const sorted = [...angles].sort((a, b) => a - b);
  let gap = { size: 0, from: 0 };
  sorted.forEach((angle, i) => {
    const next = i + 1 < sorted.length ? sorted[i + 1] : sorted[0] + 2 * Math.PI;
    if (next - angle > gap.size) gap = { size: next - angle, from: angle };
  });
  return gap;
}
