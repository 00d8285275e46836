// Asks this page's own server, one thing after the other: each change is made to the text that the one before left.
export class Client {
  // `shown(state)`: once no other request waits: an answer from before a change would be written over what was typed.
  // `failed(text)`: it was refused, or nobody answers.
  constructor(shown, failed) {
    Object.assign(this, { shown, failed, state: null, isShown: true, waiting: 0, last: Promise.resolve() });
  }

  look(path) {
    return this.after(() => this.ask(path, {}));
  }

  // `wanted`: the request's keys, or a function of the state as it then is, which may say null: nothing is asked.
  do(path, wanted = {}) {
    return this.after(() => {
      const keys = typeof wanted === "function" ? wanted(this.state) : wanted;
      if (keys === null) return null;
      const body = JSON.stringify({ revision: this.state.revision, ...keys });
      return this.ask(path, { method: "POST", headers: { "Content-Type": "application/json" }, body });
    });
  }

  upload(name, body) {
    const headers = { "Content-Type": "application/octet-stream", "X-Name": encodeURIComponent(name) };
    return this.after(() => this.ask("/stems", { method: "POST", headers, body }));
  }

  after(act) {
    this.waiting += 1;
    this.last = this.last.then(act).catch((error) => {
      this.failed(`No answer from mission edit: is it still running? (${error.message})`);
      return null;
    }).finally(() => {
      this.waiting -= 1;
      this.show();
    });
    return this.last;
  }

  show() {
    if (this.waiting > 0 || this.isShown) return;
    this.isShown = true;
    this.shown(this.state);
  }

  async ask(path, options) {
    const answer = await fetch(path, options);
    if (!answer.headers.get("Content-Type")?.startsWith("application/json")) {
      this.failed((await answer.text()).trim());
      return null;
    }
    const told = await answer.json();
    const state = path === "/state" ? told : told.state;
    if (state) {
      this.state = state;
      this.isShown = false;
    }
    if (!answer.ok) {
      this.failed(told.refused);
      return null;
    }
    return told;
  }
}
