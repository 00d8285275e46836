// An arrow to the north, which is up.
export const north = {
  name: "north",
  needs: [],

  draw(ctx, _, { ink, style }) {
    const { x, y, sizePx } = style.north;
    ctx.beginPath();
    for (const [dx, dy] of [[0, -1.6], [0.7, 0.6], [0, 0.15], [-0.7, 0.6]]) ctx.lineTo(x + dx * sizePx, y + dy * sizePx);
    ctx.closePath();
    ctx.fillStyle = ink.ink;
    ctx.strokeStyle = ink.ground;
    ctx.lineWidth = 3;
    ctx.stroke();
    ctx.fill();
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    ctx.strokeText("N", x, y + 0.7 * sizePx);
    ctx.fillText("N", x, y + 0.7 * sizePx);
  },
};
