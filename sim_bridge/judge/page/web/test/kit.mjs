// Stand-ins for what a browser gives, and a flight of two to look at.

// A drawing context that notes what is called.
export function fakeContext() {
  const calls = [];
  const state = { calls };
  const ctx = new Proxy(state, {
    get(known, name) {
      if (name in known) return known[name];
      if (name === "measureText") return (text) => ({ width: 8 * text.length });
      return (...given) => calls.push([name, ...given]);
    },
  });
  return ctx;
}

export function fakeCanvas(width = 200, height = 100) {
  const ctx = fakeContext();
  return { clientWidth: width, clientHeight: height, width: 0, height: 0, ctx, getContext: () => ctx, addEventListener() {}, setPointerCapture() {} };
}

// The globals that maps and clocks ask for.
export function setUpBrowser() {
  const frames = [];
  globalThis.window = { devicePixelRatio: 1 };
  globalThis.ResizeObserver = class {
    observe() {} // tests say themselves when something is laid out: map.resized()
  };
  globalThis.document = { createElement: () => fakeCanvas(), documentElement: { dataset: {} } };
  globalThis.getComputedStyle = () => ({ getPropertyValue: (name) => name });
  globalThis.matchMedia = () => ({ matches: false, addEventListener() {} });
  globalThis.requestAnimationFrame = (drawn) => frames.push(drawn);
  return { nextFrame: (now) => frames.splice(0).forEach((drawn) => drawn(now)) };
}

const column = (values, step = 1) => ({ order: 0, step, is: values });
const constant = (value) => ({ rows: [0], is: [value], step: 1 });
const table = (names) => Object.fromEntries(names.map((name) => [name, column([])]));

function vehicle(id, east) {
  const steps = { alive: 1, on_ground: 0, armed: 1, acting: 1, touched: 0, leader: 1, phase: 2, range_m: 50 };
  return {
    id,
    east_m: column(east),
    north_m: column(east.map(() => 0)),
    up_m: column(east.map(() => 8)),
    ...Object.fromEntries(Object.entries(steps).map(([name, value]) => [name, constant(value)])),
    estimate_off: null,
    scans: null,
  };
}

// A document as docs/reference/replay.md has it: 1 flies from 0 to 20 m east, 2 stands at 30 m; linked from row 1 on.
export function flightDocument() {
  return {
    title: "two",
    made_by: "test",
    seed: 1,
    verdict: { text: "ARRIVED", succeeded: true },
    limits: [],
    figures: {},
    mission: {
      places: [{ name: "d1", enu_m: [0, 0, 0] }, { name: "d2", enu_m: [40, 0, 8] }],
      coverage: { shape: "ring", radius_m: 10, centres_enu_m: [[40, 0, 8]] },
      fence_enu_m: [[-50, -50], [-50, 50], [90, 50], [90, -50]],
      altitude_m: [0, 20],
      separation_hard_m: 5,
      trunk_attenuation_factor: 1,
    },
    mission_toml: "",
    events: [],
    time_s: { order: 1, step: 1, is: [0, 1, 1] },
    stand: {
      trees: table(["east_m", "north_m", "radius_m", "height_m", "crown_base_m", "crown_radius_m", "ground_up_m"]),
      bushes: table(["east_m", "north_m", "radius_m", "height_m", "ground_up_m"]),
      boxes_enu_m: [[[10, 4], [20, 4], [20, 8], [10, 8]]],
    },
    swarm: { leader: constant(1), phase: constant(2), separation_m: column([30, 20, 10]) },
    vehicles: [vehicle(1, [0, 10, 20]), vehicle(2, [30, 30, 30])],
    links: [[1, 2, 1]],
  };
}
