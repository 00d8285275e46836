// Radio links; those of the selected vehicle stand out.
export const links = {
  name: "links",
  needs: ["replay", "at"],
  legend: { text: "links", order: 3, shown: true, has: (replay) => replay.vehicles.length > 1 },

  draw(ctx, view, { ink, replay, at, selected }) {
    const linked = replay.linksAt(at.row);
    const positions = replay.vehicles.map((_, k) => replay.place(k, at));
    ctx.strokeStyle = ink.link;
    for (const own of [false, true]) {
      ctx.globalAlpha = own ? 0.9 : Math.min(0.55, Math.max(0.05, 25 / Math.max(1, linked.length)));
      ctx.lineWidth = own ? 1.6 : 1;
      ctx.beginPath();
      for (const { a, b } of linked) {
        if ((selected === a || selected === b) !== own) continue;
        ctx.moveTo(view.x(positions[a][0]), view.y(positions[a][1]));
        ctx.lineTo(view.x(positions[b][0]), view.y(positions[b][1]));
      }
      ctx.stroke();
    }
  },
};
