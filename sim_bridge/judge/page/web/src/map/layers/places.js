// The mission's named places: d1, its stops, d2.
export const places = {
  name: "places",
  needs: ["mission"],

  draw(ctx, view, { ink, style, mission, labels }) {
    const { sizePx, width } = style.place;
    for (const { name, enu: [e, n] } of mission.places) {
      const [x, y] = [view.x(e), view.y(n)];
      ctx.strokeStyle = ctx.fillStyle = ink.ink;
      ctx.lineWidth = width;
      ctx.beginPath();
      ctx.moveTo(x - sizePx, y);
      ctx.lineTo(x + sizePx, y);
      ctx.moveTo(x, y - sizePx);
      ctx.lineTo(x, y + sizePx);
      ctx.stroke();
      if (labels) labels.write(name, x, y + 20);
      else {
        ctx.font = "600 13px system-ui, sans-serif";
        ctx.fillText(name, x + 7, y + 15);
      }
    }
  },
};
