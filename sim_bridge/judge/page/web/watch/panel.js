// Beside the map: one card for each vehicle, what vehicles say of others, and what nobody knows.
import { el } from "../src/dom.js";
import { vehicleColour } from "../src/theme.js";
import { FRESH_S, age, leads, positionOf } from "./picture.js";

const NEVER = "Not in beacons: why a vehicle lands, its autopilot's messages, trees, links between vehicles.";

export function roleOf(one, fresh) {
  if (leads(one)) return fresh ? "leads" : "led";
  const does = fresh ? "follows" : "followed";
  if (!one.leader) return `${does} nobody`;
  return one.acting ? `${does} ${one.leader}` : `would follow ${one.leader}`;
}

export function factsOf(one, mission) {
  const metres = mission ? `${Math.round(one.alt_m - mission.ground_alt_m)} m up` : `${Math.round(one.alt_m)} m above the sea`;
  const [north, east, down] = one.vel_ned_mps;
  return [
    one.airborne ? "in the air" : "not in the air",
    metres,
    `${Math.hypot(north, east, down).toFixed(1)} m/s`,
    one.battery_percent && `battery ${one.battery_percent[0]} to ${one.battery_percent[1]} %`,
    one.to_leader_ne_m && `leader estimated ${Math.round(Math.hypot(...one.to_leader_ne_m))} m away, ± ${one.leader_sd_m.toFixed(1)} m`,
    one.hop > 1 && `${one.hop} hops from the leader`,
  ].filter(Boolean);
}

// Written anew in place four times a second: a card that is put in anew loses the finger that is on it.
export class Card {
  constructor(id, picked) {
    this.mark = el("i", { "aria-hidden": "true" }); // its colour on the map
    this.parts = { name: el("b", {}, this.mark, `${id} `), role: el("span", {}), age: el("span", { class: "age" }), state: el("span", { class: "state" }), facts: el("span", { class: "facts" }) };
    const { name, role, age: heard, state, facts } = this.parts;
    name.append(role);
    this.button = el("button", { type: "button", class: "card", onclick: () => picked(id), "data-id": id }, name, heard, state, facts);
    this.item = el("li", {}, this.button);
  }

  write(one, mission, selected) {
    const fresh = one.age_s < FRESH_S;
    const { parts, button } = this;
    button.classList.toggle("ghost", !fresh);
    button.setAttribute("aria-pressed", selected === one.id);
    this.mark.style.setProperty("background", vehicleColour(one.id - 1)); // pages turn dark
    parts.role.textContent = roleOf(one, fresh);
    parts.age.textContent = fresh ? age(one.age_s) : `last heard ${age(one.age_s)} ago`;
    parts.state.textContent = `${fresh ? "" : "then: "}${one.state === one.phase ? one.state : `${one.state} (${one.phase})`}`;
    parts.facts.textContent = factsOf(one, mission).join(" · ");
  }
}

export function peerReports({ told, vehicles }) {
  // Own beacons from after its last one there say more than the report.
  const onGround = ({ id, age_s: reported }) => vehicles.some((own) => own.id === id && !own.airborne && own.age_s <= reported + 1);
  return told.map((one) => {
    const where = onGround(one) ? "on the ground" : "in the air";
    const what = one.silent ? `link lost ${where}` : "received";
    return `Vehicle ${one.id}: ${what}, last ${age(one.age_s)} ago; reported by ${one.by}${one.place ? "" : ", without position"}.`;
  });
}

export function unknown({ about, vehicles, not_heard: named, refused }) {
  const ids = (list) => list.join(", ");
  const { mission } = about;
  const known = new Set([...vehicles.map((one) => one.id), ...named]);
  const missing = mission ? Array.from({ length: mission.vehicles }, (_, k) => k + 1).filter((id) => !known.has(id)) : [];
  const noPlace = vehicles.filter((one) => !positionOf(one)).map((one) => one.id);
  const estimated = vehicles.filter((one) => !one.place && one.reckoned).map((one) => one.id);
  const noBattery = vehicles.filter((one) => !one.battery_percent).map((one) => one.id);
  return [
    named.length && `Never received, named by peers: ${ids(named)}.`,
    missing.length && `In the mission, never received or named: ${ids(missing)}.`,
    noPlace.length && `Position not reported: ${ids(noPlace)}.`,
    estimated.length && `GNSS-denied, drawn where estimated from their leader: ${ids(estimated)}.`,
    noBattery.length && `Battery not reported: ${ids(noBattery)}.`,
    !mission && "No mission given: fence, places and number of vehicles unknown.",
    mission && !mission.fence.length && "The mission has no fence on the ground.",
    refused && `Implausible beacons dropped: ${refused}.`,
    NEVER,
  ].filter(Boolean);
}
