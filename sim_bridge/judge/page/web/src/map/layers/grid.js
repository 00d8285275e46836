// Lines every round number of metres.
export const grid = {
  name: "grid",
  needs: [],
  still: true,

  draw(ctx, view, { ink, style }) {
    const step = view.roundMetres(style.gridPx);
    const [[west, south], [east, north]] = [view.enu(0, view.height), view.enu(view.width, 0)];
    ctx.strokeStyle = ink.grid;
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (let e = Math.ceil(west / step) * step; e <= east; e += step) {
      ctx.moveTo(Math.round(view.x(e)) + 0.5, 0);
      ctx.lineTo(Math.round(view.x(e)) + 0.5, view.height);
    }
    for (let n = Math.ceil(south / step) * step; n <= north; n += step) {
      ctx.moveTo(0, Math.round(view.y(n)) + 0.5);
      ctx.lineTo(view.width, Math.round(view.y(n)) + 0.5);
    }
    ctx.stroke();
  },
};
