// Tree crowns.
import { fillDiscs } from "../shapes.js";

const FROM_PX = 2; // px for a metre: further out crowns would be a carpet

export const crowns = {
  name: "crowns",
  needs: ["replay"],
  legend: { text: "crowns", order: 8, shown: true, has: (replay) => replay.trees.east_m.length > 0 },
  still: true,

  draw(ctx, view, { ink, replay: { trees } }) {
    if (view.scale < FROM_PX) return;
    ctx.fillStyle = ink.crown;
    fillDiscs(ctx, view, trees, (i) => (trees.height_m[i] > trees.crown_base_m[i] ? trees.crown_radius_m[i] : 0), 0);
  },
};
