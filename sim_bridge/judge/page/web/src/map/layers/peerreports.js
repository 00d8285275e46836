// Where vehicles of the watched swarm report one that fell silent.
export const peerreports = {
  name: "peerreports",
  needs: ["peerReports"],

  draw(ctx, view, { ink, peerReports, labels }) {
    for (const { id, by, enu } of peerReports) {
      if (!enu) continue;
      const [x, y] = [view.x(enu[0]), view.y(enu[1])];
      ctx.strokeStyle = ink.warn;
      ctx.lineWidth = 3;
      ctx.beginPath();
      for (const [dx, dy] of [[0, -20], [20, 16], [-20, 16]]) ctx.lineTo(x + dx, y + dy);
      ctx.closePath();
      ctx.stroke();
      labels.write(`${id}, reported by ${by}`, x, y + 32);
    }
  },
};
