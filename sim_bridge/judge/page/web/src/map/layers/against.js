// The other flight of a comparison, at the same time: squares, hollow, with dashed trails.
import { upTo } from "../../replay.js";
import { vehicleColour } from "../../theme.js";

const TRAIL_S = 12;
const SIZE_PX = 6;

export const against = {
  name: "against",
  needs: ["against"],
  legend: { text: "flight B", order: 0, shown: true, has: (replay) => Boolean(replay.against) },

  draw(ctx, view, { ink, against: other, time, style }) {
    if (!other.time.length) return;
    const at = other.at(time);
    const from = upTo(other.time, time - TRAIL_S);
    ctx.textAlign = "center";
    other.vehicles.forEach((one, k) => {
      const [east, north] = other.place(k, at);
      const [x, y] = [view.x(east), view.y(north)];
      ctx.strokeStyle = vehicleColour(k);
      ctx.lineWidth = 1.6;
      ctx.setLineDash([5, 4]);
      ctx.beginPath();
      for (let row = from; row <= at.row; row++) ctx.lineTo(view.x(one.east_m[row]), view.y(one.north_m[row]));
      ctx.lineTo(x, y);
      ctx.stroke();
      ctx.setLineDash([]);
      ctx.fillStyle = ink.ground;
      ctx.lineWidth = 2.5;
      ctx.beginPath();
      ctx.rect(x - SIZE_PX, y - SIZE_PX, 2 * SIZE_PX, 2 * SIZE_PX);
      ctx.fill();
      ctx.stroke();
      ctx.font = style.pen.font;
      ctx.lineWidth = 3;
      ctx.strokeStyle = ink.halo;
      ctx.fillStyle = ink.ink;
      const name = other.swarm.leader[at.row] === k + 1 ? `B ${k + 1} leads` : `B ${k + 1}`;
      ctx.strokeText(name, x, y + SIZE_PX + 14);
      ctx.fillText(name, x, y + SIZE_PX + 14);
    });
  },
};
