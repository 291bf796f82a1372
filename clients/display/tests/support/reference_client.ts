// A second client of /state beside the page, which acknowledges at once: when it received what, by the wall clock.
import { randomBytes } from "node:crypto";
import { connect, type Socket } from "node:net";
import { decodeFrame, type Frame } from "../../src/state/frame.ts";
import type { RecordOf } from "../../src/state/layout.ts";

export interface ReceivedTool {
  readonly at_ms: number; // Date.now() of this host, which is also the page's
  readonly tool: RecordOf<"tool">;
  readonly drawable: boolean; // a pose that was not over when the gateway wrote it
}

const kRetry_ms = 50;
const kHead = Buffer.from("\r\n\r\n");

export class ReferenceClient {
  readonly tools: ReceivedTool[] = [];
  private socket: Socket | null = null;
  private stopped = false;

  constructor(private readonly port: number) {
    this.open();
  }

  // When it first received a drawable pose from `since_ms` on; NaN: not yet.
  firstDrawable(since_ms: number): number {
    return this.tools.find((t) => t.at_ms >= since_ms && t.drawable)?.at_ms ?? Number.NaN;
  }

  stop(): void {
    this.stopped = true;
    this.socket?.destroy();
  }

  private open(): void {
    if (this.stopped) return;
    const socket = connect(this.port, "127.0.0.1");
    this.socket = socket;
    let received: Buffer = Buffer.alloc(0);
    let upgraded = false;
    socket.on("connect", () => {
      const key = randomBytes(16).toString("base64");
      socket.write(
        `GET /state HTTP/1.1\r\nHost: localhost:${this.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: ${key}\r\nSec-WebSocket-Version: 13\r\n\r\n`,
      );
    });
    socket.on("data", (data: Buffer) => {
      received = Buffer.concat([received, data]);
      if (!upgraded) {
        const end = received.indexOf(kHead);
        if (end < 0) return;
        upgraded = true;
        received = received.subarray(end + kHead.length);
      }
      received = this.read(socket, received);
    });
    socket.on("error", () => {});
    socket.on("close", () => setTimeout(() => this.open(), kRetry_ms));
  }

  // Messages of the gateway are not masked, and each is one frame of the protocol. Returns what is not whole yet.
  private read(socket: Socket, received: Buffer): Buffer {
    let data = received;
    for (;;) {
      if (data.length < 10) return data;
      const short = data[1] & 0x7f;
      const head = short < 126 ? 2 : short === 126 ? 4 : 10;
      const length = short < 126 ? short : short === 126 ? data.readUInt16BE(2) : Number(data.readBigUInt64BE(2));
      if (data.length < head + length) return data;
      if ((data[0] & 0x0f) === 2) this.take(socket, Buffer.from(data.subarray(head, head + length)));
      data = data.subarray(head + length);
    }
  }

  private take(socket: Socket, message: Buffer): void {
    const at_ms = Date.now();
    const frame = decodeFrame(new Uint8Array(message).buffer);
    for (const record of frame.records) {
      if (record.name !== "tool" || record.ended) continue;
      const tool = record.value as RecordOf<"tool">;
      this.tools.push({ at_ms, tool, drawable: isDrawable(tool, frame) });
    }
    socket.write(acknowledgement(frame.number));
  }
}

const isDrawable = (tool: RecordOf<"tool">, frame: Frame): boolean =>
  (tool.status === 1 || tool.status === 2) && tool.valid_until_ms > frame.written_ms;

// Masked with zeros: 16 bytes in one frame.
function acknowledgement(number: number): Buffer {
  const out = Buffer.alloc(2 + 4 + 16);
  out[0] = 0x82;
  out[1] = 0x80 | 16;
  out.writeUInt32LE(1, 6);
  out.writeUInt32LE(number, 10);
  return out;
}
