// Texts on a map that keep clear of each other.
const LINE_PX = 18;

export class Labels {
  constructor(ctx, view, ink) {
    Object.assign(this, { ctx, view, ink });
    this.taken = []; // where some are already
  }

  write(text, x, wanted, align = "center") {
    const { ctx } = this;
    ctx.textAlign = align;
    const y = this.reserve(ctx.measureText(text).width, x, wanted, align);
    ctx.lineWidth = 5;
    ctx.strokeStyle = this.ink.ground;
    ctx.strokeText(text, x, y);
    ctx.fillStyle = this.ink.ink;
    ctx.fillText(text, x, y);
  }

  // The height nearest to the one wanted where no other label is.
  reserve(width, x, wanted, align) {
    const left = align === "left" ? x : x - width / 2;
    const beside = (y) => this.taken.every((one) => one.right < left || one.left > left + width || Math.abs(one.y - y) >= LINE_PX);
    const inside = (y) => y >= LINE_PX / 2 && y <= this.view.height - LINE_PX / 2;
    const y = [0, -1, 1, -2, 2].map((lines) => wanted + lines * LINE_PX).find((one) => inside(one) && beside(one)) ?? wanted;
    this.taken.push({ left, right: left + width, y });
    return y;
  }
}
