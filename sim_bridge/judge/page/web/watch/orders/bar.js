// Four buttons below the page, where `companion watch --orders` takes orders of it.
import { el } from "../../src/dom.js";
import { Hold } from "./hold.js";
import { isRight, takeKey } from "./orderkey.js";
import { send } from "./send.js";
import { Settled, progressOf, questionOf, releasedOf } from "./words.js";

const ASKED_MS = 500; // a second tap of the same finger confirms nothing
const START_MS = 1000; // who takes off is to be read
const TOLD_MS = 200; // between two looks at whether a button may act
const NO_KEY = "This page only watches: its address had no key of orders, or that of an earlier start. Open the one that the terminal prints.";

const KINDS = ["START", "HOLD", "LAND", "ABORT"];

const write = (node, text) => node.textContent !== text && (node.textContent = text);

export class OrderBar {
  constructor() {
    this.orders = null; // of the last picture
    this.vehicles = [];
    this.asked = null; // the kind that is asked about
    this.own = ""; // of this page's last order
    this.key = null;
    const button = (kind, act) => el("button", { type: "button", class: `order ${kind.toLowerCase()}`, onclick: act }, kind);
    this.buttons = KINDS.slice(0, 3).map((kind) => button(kind, () => this.ask(kind)));
    const abort = el("button", { type: "button", class: "order abort" }, "ABORT", el("small", {}, "hold 1 s"));
    this.hold = new Hold(abort, { held: () => this.send({ kind: "ABORT" }), tapped: () => this.ask("ABORT") });
    this.buttons.push(abort);
    this.lines = el("div", { class: "lines" });
    this.back = el("select", { "aria-label": "Hand back", onchange: () => this.write() });
    this.confirm = el("button", { type: "button", class: "confirm", onclick: () => this.maySend && this.send(this.order) });
    const no = el("button", { type: "button", onclick: () => this.ask(null) }, "No");
    const esc = (event) => event.key === "Escape" && this.ask(null);
    this.question = el("div", { class: "question", role: "group", "aria-label": "Confirm", hidden: true, onkeydown: esc }, this.lines, this.back, this.confirm, no);
    this.progress = el("p", { class: "progress", role: "status" });
    this.row = el("div", { class: "row" }, this.buttons);
    this.section = el("section", { class: "orders", "aria-label": "Orders", hidden: true }, this.progress, this.question, this.row);
    this.settled = new Settled(ASKED_MS);
    this.take();
    addEventListener("hashchange", () => this.take());
    setInterval(() => this.asked && this.write(), TOLD_MS);
  }

  take() {
    this.key = takeKey({ location, history, storage: sessionStorage });
    this.write();
  }

  // Of a picture.
  show({ orders, vehicles }) {
    [this.orders, this.vehicles] = [orders, vehicles];
    this.write();
  }

  // null: no more.
  ask(kind) {
    const before = this.asked;
    this.asked = kind;
    this.own = kind ? "" : this.own;
    this.settled = new Settled(kind === "START" ? START_MS : ASKED_MS);
    this.write();
    if (kind) this.confirm.focus();
    else this.buttons[KINDS.indexOf(before)].focus();
  }

  async send(order) {
    if (this.asked) this.ask(null);
    this.own = `${order.kind}: sending`;
    this.write();
    const why = await send(order, { key: this.key, nonce: () => this.orders?.nonce ?? null });
    if (why && order.kind === "START" && !this.asked) this.ask("START"); // with who is ready by now
    this.own = why && `${order.kind}: not ordered: ${why}`;
    this.write();
  }

  write() {
    this.section.hidden = !this.orders;
    if (!this.orders) return;
    const may = isRight(this.key, this.orders);
    this.row.hidden = !may;
    if (!may) this.asked = null;
    const told = may ? [] : [NO_KEY];
    write(this.progress, [...told, this.own, ...progressOf(this.orders.sent)].filter(Boolean).join("\n"));
    this.writeQuestion();
  }

  writeQuestion() {
    this.question.hidden = !this.asked;
    if (!this.asked) return;
    this.writeBack(this.asked === "START" ? releasedOf(this.vehicles) : []);
    const { lines, confirm, order } = questionOf(this.asked, this.orders, Number(this.back.value));
    write(this.lines, lines.join("\n"));
    write(this.confirm, confirm);
    this.order = order;
    this.maySend = this.settled.isSo([...lines, confirm].join("\n"), performance.now()) && order !== null;
    this.confirm.setAttribute("aria-disabled", !this.maySend);
  }

  // Whom to hand back: nobody, unless somebody is chosen.
  writeBack(released) {
    this.back.hidden = !released.length;
    const ids = ["0", ...released.map(String)];
    if ([...this.back.options].map((one) => one.value).join() === ids.join()) return;
    const chosen = ids.includes(this.back.value) ? this.back.value : "0";
    this.back.replaceChildren(...ids.map((id) => el("option", { value: id }, id === "0" ? "Hand nobody back" : `Hand back vehicle ${id}`)));
    this.back.value = chosen;
  }
}
