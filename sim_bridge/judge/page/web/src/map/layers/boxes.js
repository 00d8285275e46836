// Walls and buildings.
import { trace } from "../shapes.js";

export const boxes = {
  name: "boxes",
  needs: ["replay"],
  still: true,

  draw(ctx, view, { ink, replay }) {
    ctx.fillStyle = ink.bush;
    ctx.strokeStyle = ink.trunk;
    ctx.lineWidth = 1;
    for (const corners of replay.boxes) {
      trace(ctx, view, corners, true);
      ctx.fill();
      ctx.stroke();
    }
  },
};
