// Where a page gets what it shows: a document in the page itself, or a stream, whose first message holds the document.
import { unpack } from "./replay.js";

// A JSON message each. `taken` is called with all that come after the first; `lost` when there will be none any more.
class Stream {
  constructor(path) {
    const url = new URL(path, location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    this.taken = () => {};
    this.lost = () => {};
    this.early = [];
    this.socket = new WebSocket(url);
    this.first = new Promise((resolve, reject) => {
      this.socket.onmessage = ({ data }) => {
        resolve(JSON.parse(data));
        this.socket.onmessage = (next) => this.take(JSON.parse(next.data));
      };
      this.socket.onclose = () => reject(new Error("nothing is heard from the program that sends it"));
    });
  }

  take(message) {
    if (this.early) this.early.push(message);
    else this.taken(message);
  }

  // Hand over, from now on, what comes; first what has come meanwhile.
  start(taken, lost) {
    [this.taken, this.lost] = [taken, lost];
    this.socket.onclose = () => this.lost();
    const { early } = this;
    this.early = null;
    early.forEach(taken);
    if (this.socket.readyState > WebSocket.OPEN) lost();
  }

  ask(wish) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wish));
  }
}

export async function source() {
  const node = document.getElementById("data");
  if (!node.dataset.stream) return { doc: await unpack(node.textContent), stream: null };
  const stream = new Stream(node.dataset.stream);
  return { doc: await stream.first, stream };
}
