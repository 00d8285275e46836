// A button that acts once it was pressed for a while. A short press, a key and a screen reader's click are told apart from it.
export const HOLD_MS = 1000;

export class Hold {
  constructor(node, { held, tapped, ms = HOLD_MS }) {
    this.node = node;
    this.timer = null;
    this.done = false; // the click that follows is of this press
    const on = (names, act) => names.forEach((name) => node.addEventListener(name, act));
    on(["pointerdown"], (event) => event.isPrimary && event.button === 0 && this.begin(event, held, ms));
    on(["pointerup", "pointercancel", "lostpointercapture"], () => this.end());
    on(["contextmenu"], (event) => event.preventDefault()); // what a long touch asks for
    on(["click"], (event) => {
      if (event.detail && this.done) return;
      tapped();
    });
  }

  begin(event, held, ms) {
    this.end();
    this.done = false;
    this.node.setPointerCapture(event.pointerId); // a glove slips
    this.node.classList.add("held");
    this.timer = setTimeout(() => {
      this.end();
      this.done = true;
      held();
    }, ms);
  }

  end() {
    clearTimeout(this.timer);
    this.node.classList.remove("held");
  }
}
