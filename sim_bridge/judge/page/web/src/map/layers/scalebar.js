// A round number of metres, as long as they are.
export const scalebar = {
  name: "scalebar",
  needs: [],

  draw(ctx, view, { ink, style, labels }) {
    const metres = view.roundMetres(style.scalePx);
    if (labels) drawBold(ctx, view, { metres, ink, labels });
    else drawFine(ctx, view, { metres, ink });
  },
};

function drawFine(ctx, view, { metres, ink }) {
  const [x, y, px] = [12, view.height - 14, metres * view.scale];
  ctx.strokeStyle = ctx.fillStyle = ink.ink;
  ctx.lineWidth = 1.5;
  ctx.beginPath();
  ctx.moveTo(x, y - 4);
  ctx.lineTo(x, y);
  ctx.lineTo(x + px, y);
  ctx.lineTo(x + px, y - 4);
  ctx.stroke();
  ctx.fillText(`${metres} m`, x + 4, y - 6);
}

function drawBold(ctx, view, { metres, ink, labels }) {
  const [x, y, px] = [14, view.height - 16, metres * view.scale];
  for (const [width, colour] of [[8, ink.ground], [4, ink.ink]]) {
    ctx.lineWidth = width;
    ctx.strokeStyle = colour;
    ctx.beginPath();
    ctx.moveTo(x, y);
    ctx.lineTo(x + px, y);
    ctx.stroke();
  }
  labels.write(`${metres} m`, x + px + 8, y, "left");
}
