// The reader's own map under the vehicles.
export const chart = {
  name: "chart",
  needs: ["chart", "plane"],
  still: true,

  draw(ctx, view, data) {
    data.chart.draw(ctx, view, data.plane);
  },
};
