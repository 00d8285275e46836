// Where a page gets what it shows: a document in the page itself, or a stream, whose first message holds the document.
import { unpack } from "./replay.js";

const AROUND = "around"; // data-stream of a page that another one frames, and sends to

// A JSON message each. `taken` is called with all that come after the first; `lost` when there will be none any more.
class Stream {
  constructor() {
    this.taken = () => {};
    this.lost = () => {};
    this.early = [];
    this.begun = false;
    this.closed = false;
    this.first = new Promise((resolve, reject) => {
      Object.assign(this, { resolve, reject });
    });
  }

  receive(text) {
    const message = JSON.parse(text);
    if (!this.begun) {
      this.begun = true;
      this.resolve(message);
    } else if (this.early) this.early.push(message);
    else this.taken(message);
  }

  close() {
    this.closed = true;
    this.reject(new Error("nothing is heard from the program that sends it"));
    this.lost();
  }

  // Hand over, from now on, what comes; first what has come meanwhile.
  start(taken, lost) {
    [this.taken, this.lost] = [taken, lost];
    const { early } = this;
    this.early = null;
    early.forEach(taken);
    if (this.closed) lost();
  }
}

function overSocket(path) {
  const url = new URL(path, location.href);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  const stream = new Stream();
  const socket = new WebSocket(url);
  socket.onmessage = ({ data }) => stream.receive(data);
  socket.onclose = () => stream.close();
  stream.ask = (wish) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(wish));
  };
  return stream;
}

// The page around this one hands the other end of the channel to whoever flies.
function fromAround() {
  const stream = new Stream();
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = ({ data }) => stream.receive(data);
  stream.ask = (wish) => port1.postMessage(JSON.stringify(wish));
  parent.postMessage("understory-view", location.origin, [port2]);
  return stream;
}

export async function source() {
  const node = document.getElementById("data");
  const { stream: path } = node.dataset;
  if (!path) return { doc: await unpack(node.textContent), stream: null };
  const stream = path === AROUND ? fromAround() : overSocket(path);
  return { doc: await stream.first, stream };
}
