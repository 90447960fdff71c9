// WebSocket to the page's server. Each update answers a request of this page, so nothing is queued anywhere.

const READER = new TextDecoder();
const QUICK_MS = 40, LONGEST_PAUSE_MS = 500;

export class LiveSocket {
  constructor(onUpdate, onLost) {
    this.onUpdate = onUpdate;
    this.onLost = onLost;
    this.streams = [];
    this.socket = null;
    this.open();
  }

  open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.socket = socket;
      this.send({ kind: "streams", streams: this.streams });
      this.next();
    };
    socket.onmessage = (event) => {
      const { head, frames } = parse(event.data);
      const came = performance.now();
      // A hidden page gets no animation frames, and so requests nothing.
      requestAnimationFrame(() => {
        try { this.onUpdate(head, frames); } finally { requestAnimationFrame(() => this.requestNext(came)); }
      });
    };
    socket.onclose = () => {
      this.socket = null;
      this.onLost();
      setTimeout(() => this.open(), 1000);
    };
  }

  // By the second animation frame the update is on the screen. If drawing took long, the page waits as long again: the
  // run often shares its machine with the browser.
  requestNext(came) {
    const extra = performance.now() - came - QUICK_MS;
    if (extra > 0) setTimeout(() => this.next(), Math.min(extra, LONGEST_PAUSE_MS)); else this.next();
  }

  next() { this.send({ kind: "next" }); }

  watch(streams) {
    this.streams = streams;
    this.send({ kind: "streams", streams });
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
