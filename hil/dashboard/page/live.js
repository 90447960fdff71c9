// The socket: an update comes when this page has said that it can take one, so nothing piles up anywhere.

const READER = new TextDecoder();
const QUICK_MS = 40, LONGEST_REST_MS = 500;

export class Live {
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
      this.say({ kind: "streams", streams: this.streams });
      this.next();
    };
    socket.onmessage = (event) => {
      const { head, frames } = parse(event.data);
      const came = performance.now();
      // A page that nobody sees draws no frames of its own, and so asks for nothing.
      requestAnimationFrame(() => {
        try { this.onUpdate(head, frames); } finally { requestAnimationFrame(() => this.rest(came)); }
      });
    };
    socket.onclose = () => {
      this.socket = null;
      this.onLost();
      setTimeout(() => this.open(), 1000);
    };
  }

  // By the second frame what was drawn is on the screen. A machine on which that takes long also flies the run: the page
  // then rests as long as it drew.
  rest(came) {
    const extra = performance.now() - came - QUICK_MS;
    if (extra > 0) setTimeout(() => this.next(), Math.min(extra, LONGEST_REST_MS)); else this.next();
  }

  next() { this.say({ kind: "next" }); }

  watch(streams) {
    this.streams = streams;
    this.say({ kind: "streams", streams });
  }

  say(message) {
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
