// What each vehicle of a flight did, in a row; its button stays with it on the map.
import { el, seconds } from "./dom.js";
import { vehicleColour } from "./theme.js";

const or = (value, text) => (value === null ? "–" : text(value));
const at = (time) => (time === null ? "" : ` at ${seconds(time)}`);

// Heading, and the text of a cell. Every number has its unit in the cell, or in the heading.
const COLUMNS = [
  ["way flown", (row) => `${row.way_m.toFixed(0)} m`],
  ["closest to another", (row) => or(row.nearest_m, (m) => `${m.toFixed(2)} m to ${row.nearest_id}${at(row.nearest_at_s)}`)],
  ["closest to bark", (row) => or(row.bark_m, (m) => `${m.toFixed(2)} m${at(row.bark_at_s)}`)],
  ["behind the first at d2", (row) => (row.behind_s === null ? "never there" : seconds(row.behind_s))],
  ["holds", (row) => or(row.holds, String)],
  ["beacons lost", (row) => or(row.beacons_lost, (share) => `${(100 * share).toFixed(1)} %`)],
  ["battery left", (row) => or(row.battery_pct, (percent) => `${percent} %`)],
  ["last words", (row) => (row.last_text ? `${row.last_text} (${seconds(row.last_text_s)})` : "–")],
];

export class VehicleTable {
  // `view`: where a vehicle is followed; null: of flight B, which is drawn beside another.
  constructor(root, replay, view) {
    const title = view ? (replay.against ? "Vehicles of A" : "Vehicles") : "Vehicles of B";
    this.view = view;
    this.rows = replay.byVehicle.map((row, k) => this.row(row, k));
    root.append(...[
      el("h2", {}, title),
      el("div", { class: "wide", tabindex: "0", role: "group", "aria-label": title }, el("table", { class: "vehicles" },
        el("thead", {}, el("tr", {}, ["vehicle", ...COLUMNS.map(([name]) => name)].map((name) => el("th", { scope: "col" }, name)))),
        el("tbody", {}, this.rows.map(({ made }) => made)))),
      view && el("p", { class: "note" }, "A click on a vehicle follows it in 2D and 3D. Beacons lost: of those sent within its radio range."),
    ].filter(Boolean));
  }

  row(row, k) {
    const dot = el("i", { "aria-hidden": "true" });
    const button = el("button", { type: "button", "aria-pressed": false, "aria-label": `follow vehicle ${row.id}`, onclick: () => this.view.follow(k) }, dot, String(row.id));
    const made = el("tr", {}, el("th", { scope: "row" }, this.view ? button : String(row.id)), COLUMNS.map(([, text]) => el("td", {}, text(row))));
    return { made, button, dot };
  }

  show() {
    if (!this.view) return;
    const { selected, layers } = this.view;
    this.rows.forEach(({ button, dot }, k) => {
      button.setAttribute("aria-pressed", layers.follow && selected === k);
      dot.style.setProperty("background", vehicleColour(k));
    });
  }
}
