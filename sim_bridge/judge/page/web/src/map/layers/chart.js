// The operator's own map under the vehicles of the watched swarm.
export const chart = {
  name: "chart",
  needs: ["chart", "plane"],

  draw(ctx, view, data) {
    data.chart.draw(ctx, view, data.plane);
  },
};
