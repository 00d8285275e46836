// The fields beside the map: each says its unit, what it is about, and what `mission check` has against it.
import { el } from "../src/dom.js";
import { readValue, shownValue } from "./words.js";

export class Form {
  // `changed(key, value)`: a reader wants it so; value undefined: the default again. `wrong(text)`: what was typed is no number.
  constructor(changed, wrong) {
    Object.assign(this, { changed, wrong });
    this.node = el("div", { class: "form" });
    this.inputs = new Map(); // by key
  }

  build(groups) {
    if (this.inputs.size) return;
    for (const group of groups) {
      const rows = group.fields.map((field) => this.row(field));
      this.node.append(el("fieldset", { "data-group": group.name }, el("legend", {}, group.name), ...rows));
    }
  }

  row(field) {
    const id = `field-${field.key}`;
    const input = field.kind === "choice" ? el("select", { id }, field.choices.map((one) => el("option", { value: one }, one))) : el("input", { id, ...typeOf(field) });
    const why = el("p", { class: "why", id: `${id}-why`, hidden: true });
    input.setAttribute("aria-describedby", why.id);
    input.title = field.about;
    input.addEventListener("change", () => this.read(field, input));
    this.inputs.set(field.key, { input, why, field });
    const unit = field.unit ? el("span", { class: "unit" }, field.unit) : null;
    return el("div", { class: "row" }, el("label", { for: id, title: field.about }, field.label), el("span", { class: "value" }, input, unit), why);
  }

  read(field, input) {
    const read = readValue(field.kind, input.value);
    if (read.wrong) this.wrong(`${field.label}: must be a number`);
    else this.changed(field.key, read.value);
  }

  // `reasons`: by key, what is against it.
  show(fields, reasons) {
    for (const [key, { input, why, field }] of this.inputs) {
      const text = shownValue(fields[key]);
      fill(input, text);
      const row = input.closest(".row");
      row.hidden = key.startsWith("sensing.") && fields[key] === null;
      explain(input, why, reasons.get(key) ?? []);
      row.classList.toggle("bad", !why.hidden);
      input.required = field.kind === "number" && text === "";
    }
    for (const group of this.node.children) group.hidden = [...group.querySelectorAll(".row")].every((row) => row.hidden);
  }

  focus(key) {
    this.inputs.get(key)?.input.focus();
  }
}

function typeOf({ kind, step }) {
  if (kind === "string") return { type: "text", maxlength: 80, autocomplete: "off" };
  return { type: "number", step, inputmode: "decimal" };
}

// What a field shows, but not over what is being typed there.
export function fill(input, text) {
  if (document.activeElement === input && ![input.dataset.shown ?? "", text].includes(input.value)) return;
  input.value = input.dataset.shown = text;
}

export function explain(input, why, texts) {
  why.hidden = texts.length === 0;
  why.replaceChildren(...texts.map((text) => el("span", {}, text)));
  if (texts.length) input.setAttribute("aria-invalid", "true");
  else input.removeAttribute("aria-invalid");
}
