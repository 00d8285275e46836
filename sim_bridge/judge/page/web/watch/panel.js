// Beside the map: one card for each vehicle, what vehicles say of others, and what nobody knows.
import { el } from "../src/dom.js";
import { FRESH_S, age } from "./watchmap.js";

const NEVER = "Why a vehicle lands, what its autopilot says, trees, and which vehicles hear each other: beacons do not say.";

export function role(one) {
  if (one.acting && one.leader === one.id) return "leads";
  if (!one.leader) return "follows nobody";
  return one.acting ? `follows ${one.leader}` : `would follow ${one.leader}`;
}

function facts(one, mission) {
  const metres = one.place && (mission ? `${Math.round(one.place[2] - mission.ground_alt_m)} m up` : `${Math.round(one.place[2])} m above the sea`);
  const [north, east, down] = one.vel_ned_mps;
  return [
    one.airborne ? "in the air" : "not in the air",
    metres ?? "does not tell its place",
    `${Math.hypot(north, east, down).toFixed(1)} m/s`,
    one.battery_percent && `battery ${one.battery_percent[0]} to ${one.battery_percent[1]} %`,
    one.to_leader_ne_m && `leader ${Math.round(Math.hypot(...one.to_leader_ne_m))} m off, ± ${one.leader_sd_m.toFixed(1)} m, it believes`,
    one.hop > 1 && `${one.hop} hops from the leader`,
  ].filter(Boolean);
}

export function card(one, mission, selected, picked) {
  const fresh = one.age_s < FRESH_S;
  return el(
    "li",
    {},
    el(
      "button",
      { type: "button", class: `card ${fresh ? "" : "ghost"}`, "aria-pressed": selected === one.id, onclick: () => picked(one.id), "data-id": one.id },
      el("b", {}, `${one.id} `, el("span", {}, role(one))),
      el("span", { class: "age" }, fresh ? age(one.age_s) : `last heard ${age(one.age_s)} ago`),
      el("span", { class: "state" }, `${fresh ? "" : "then: "}${one.state === one.phase ? one.state : `${one.state} (${one.phase})`}`),
      el("span", { class: "facts" }, facts(one, mission).join(" · ")),
    ),
  );
}

export function hearsay({ told }) {
  return told.map((one) => {
    const what = one.silent ? "fell silent in the air" : "is heard";
    return `Vehicle ${one.by} says that ${one.id} ${what}, last ${age(one.age_s)} ago${one.place ? "" : ", but not where"}.`;
  });
}

export function unknown({ about, vehicles, not_heard: named, refused }) {
  const ids = (list) => list.join(", ");
  const { mission } = about;
  const known = new Set([...vehicles.map((one) => one.id), ...named]);
  const missing = mission ? Array.from({ length: mission.vehicles }, (_, k) => k + 1).filter((id) => !known.has(id)) : [];
  const noPlace = vehicles.filter((one) => !one.place).map((one) => one.id);
  const noBattery = vehicles.filter((one) => !one.battery_percent).map((one) => one.id);
  return [
    named.length && `Never heard here, but others name them: ${ids(named)}.`,
    missing.length && `In the mission, and never heard of: ${ids(missing)}.`,
    noPlace.length && `Do not tell their place: ${ids(noPlace)}.`,
    noBattery.length && `Batteries that are not told: ${ids(noBattery)}.`,
    !mission && "Fence, places and number of vehicles: no mission was given.",
    mission && !mission.fence.length && "The mission has no fence on the ground.",
    refused && `Beacons that cannot be believed: ${refused}.`,
    NEVER,
  ].filter(Boolean);
}
