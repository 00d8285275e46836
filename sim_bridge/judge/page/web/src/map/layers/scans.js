// Obstacle scans: a ray to each return.
import { SCAN_ROWS } from "../../replay.js";
import { vehicleColour } from "../../theme.js";

export const scans = {
  name: "scans",
  needs: ["replay", "at"],
  legend: { text: "scans", order: 5, shown: true, has: (replay) => replay.vehicles.some((one) => one.scans) },

  draw(ctx, view, { replay, at, selected }) {
    replay.vehicles.forEach((one, k) => {
      const dimmed = selected !== null && selected !== k;
      if (!one.scans || dimmed || !one.alive[at.row]) return;
      const scan = replay.scanAt(k, at.row);
      if (!scan || scan.age > SCAN_ROWS) return;
      const [east, north] = replay.place(k, at);
      ctx.strokeStyle = ctx.fillStyle = vehicleColour(k);
      ctx.globalAlpha = 0.35;
      ctx.lineWidth = 1;
      ctx.beginPath();
      for (const [e, n] of scan.points) {
        ctx.moveTo(view.x(east), view.y(north));
        ctx.lineTo(view.x(e), view.y(n));
      }
      ctx.stroke();
      ctx.globalAlpha = 1;
      for (const [e, n] of scan.points) ctx.fillRect(view.x(e) - 1.5, view.y(n) - 1.5, 3, 3);
    });
  },
};
