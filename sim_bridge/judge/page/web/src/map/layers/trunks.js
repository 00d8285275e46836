// Tree trunks and bushes.
import { fillDiscs } from "../shapes.js";

export const trunks = {
  name: "trunks",
  needs: ["replay"],
  still: true,

  draw(ctx, view, { ink, replay: { trees, bushes } }) {
    ctx.fillStyle = ink.bush;
    fillDiscs(ctx, view, bushes, (i) => bushes.radius_m[i], 0);
    ctx.fillStyle = ink.trunk;
    fillDiscs(ctx, view, trees, (i) => trees.radius_m[i], 1.3);
  },
};
