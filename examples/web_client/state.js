// Prints the tip of every live tool, from bregma-gateway, by its binary messages (docs/gateway.md). No packages: a browser,
// or Node.js from version 22 (node --experimental-websocket before).
//
//     node state.js [ws://localhost:8310/state]
"use strict";

const kTool = 5; // record kinds and offsets are those of docs/gateway.md
const kLive = 1;
const kUnverified = 2;

// The shortest exchange of pings states the gateway's clock best.
class GatewayClock {
  offset = NaN;
  shortest = Infinity;
  add(sent, received, written, arrived) {
    const round = arrived - sent - (written - received);
    if (round < this.shortest) {
      this.shortest = round;
      this.offset = (received - sent + (written - arrived)) / 2;
    }
  }
  now() {
    return performance.now() + this.offset;
  }
}

const text = (view, at, size) =>
  new TextDecoder().decode(new Uint8Array(view.buffer, at, size)).replace(/\0.*$/s, "");
const numbers = (view, at, count) => Array.from({ length: count }, (_, i) => view.getFloat64(at + 8 * i, true));

const url = globalThis.process?.argv[2] ?? "ws://localhost:8310/state";
const socket = new WebSocket(url);
const clock = new GatewayClock();
socket.binaryType = "arraybuffer";

function request(kind, value, time = 0) {
  const message = new DataView(new ArrayBuffer(16));
  message.setUint32(0, kind, true);
  message.setUint32(4, value, true);
  message.setFloat64(8, time, true);
  socket.send(message.buffer);
}

socket.onopen = () => {
  request(2, 10); // ten frames per second
  request(3, 0, performance.now());
};

socket.onmessage = (event) => {
  const arrived = performance.now();
  const view = new DataView(event.data);
  for (let at = 24, left = view.getUint16(6, true); left > 0; --left) {
    const kind = view.getUint16(at, true);
    const ended = (view.getUint16(at + 2, true) & 1) !== 0;
    if (kind === 1) {
      const [sent, received, written] = numbers(view, at + 8, 3);
      clock.add(sent, received, written, arrived);
    } else if (kind === kTool && !ended) {
      show(view, at);
    }
    at += view.getUint32(at + 4, true);
  }
  request(1, view.getUint32(8, true)); // acknowledged: the next one may come
};

function show(view, at) {
  const status = view.getInt32(at + 80, true);
  const valid_until = view.getFloat64(at + 64, true);
  const [acquired] = numbers(view, at + 48, 1);
  // Not "status === kLive" alone: the time of a pose runs out on the way, too.
  if (!(status === kLive || status === kUnverified) || !(clock.now() < valid_until)) {
    return;
  }
  const tip = numbers(view, at + 160, 3).map((x) => x.toFixed(2).padStart(8));
  const note = status === kUnverified ? "   NOT VERIFIED" : "";
  console.log(`${text(view, at + 8, 32).padEnd(16)} ${tip.join(" ")} mm   ${(clock.now() - acquired).toFixed(0)} ms old${note}`);
}

socket.onerror = () => console.error(`state.js: no gateway at ${url}`);
socket.onclose = () => console.error("state.js: the connection is closed");
