// WebSocket to the page's server. Each update answers a request of this page, so updates are not queued.

const READER = new TextDecoder();
const FAST_DRAW_MS = 40,
  MAX_PAUSE_MS = 500;

export class LiveSocket {
  constructor(onUpdate, onLost) {
    this.onUpdate = onUpdate;
    this.onLost = onLost;
    this.streams = [];
    this.vehicle = ""; // whose streams, in a run of several; empty: the first
    this.socket = null;
    this.open();
  }

  open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.socket = socket;
      this.watch(this.streams);
      this.next();
    };
    socket.onmessage = (event) => {
      const { head, frames } = parse(event.data);
      const receivedMs = performance.now();
      // A hidden page gets no animation frames, and so requests nothing.
      requestAnimationFrame(() => {
        try {
          this.onUpdate(head, frames);
        } finally {
          requestAnimationFrame(() => this.requestNext(receivedMs));
        }
      });
    };
    socket.onclose = () => {
      this.socket = null;
      this.onLost();
      setTimeout(() => this.open(), 1000);
    };
  }

  // Called in the second animation frame, when the update is on the screen. After slow drawing the page pauses, because
  // the run is often on the browser's machine.
  requestNext(receivedMs) {
    const extra = performance.now() - receivedMs - FAST_DRAW_MS;
    if (extra > 0) setTimeout(() => this.next(), Math.min(extra, MAX_PAUSE_MS));
    else this.next();
  }

  next() {
    this.send({ kind: "next" });
  }

  watch(streams) {
    this.streams = streams;
    this.send({ kind: "streams", streams: ["drawings", ...streams], vehicle: this.vehicle });
  }

  send(message) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}

export function parse(data) {
  const length = new DataView(data).getUint32(0, true);
  const head = JSON.parse(READER.decode(new Uint8Array(data, 4, length)));
  const frames = [];
  let at = 4 + length;
  for (const frame of head.frames) {
    frames.push({ ...frame, data: data.slice(at, at + frame.length) });
    at += frame.length;
  }
  return { head, frames };
}
