// Speaks the contract of docs/gateway.md to one or more pages, with states that a test sets.
import { createHash } from "node:crypto";
import { createReadStream, existsSync } from "node:fs";
import { createServer, type IncomingMessage, type Server, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";
import { join } from "node:path";
import type { Duplex } from "node:stream";
import type { RecordName, RecordOf } from "../../src/state/layout.ts";
import { fakeCase, kEntry, kHash, kTarget } from "./fake_case.ts";
import { encodeFrame, liveTool, record, type TestRecord } from "./frames.ts";

const kTypes: Record<string, string> = {
  html: "text/html",
  js: "text/javascript",
  css: "text/css",
  svg: "image/svg+xml",
};
// What bregma-gateway sends with the page: nothing from elsewhere, no script or style in the page itself.
const kPolicy = "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'";

interface Client {
  readonly socket: Duplex;
  acknowledged: boolean;
  pongs: { client_ms: number; received_ms: number }[];
}

export class FakeGateway {
  tool: (now_ms: number) => Partial<RecordOf<"tool">> = (now_ms) => insertion(now_ms);
  others = new Map<string, TestRecord>(); // further records of every frame, by a name of the test
  link: Partial<RecordOf<"link">> = {};
  case: Partial<RecordOf<"case">> = {};
  paused = false; // sends nothing, as a stopped process; sockets remain open
  frozen = false; // sends frames, but the daemon's states are those of before: time stands still for it
  private readonly clients = new Set<Client>();
  private readonly server: Server;
  private readonly case_ = fakeCase();
  private frame = 0;
  private frozenAt_ms = 0;
  private timer: ReturnType<typeof setInterval> | undefined;

  constructor(private readonly page: string) {
    this.server = createServer((request, response) => this.answer(request, response));
    this.server.on("upgrade", (request, socket) => this.upgrade(request, socket));
  }

  async start(port = 0): Promise<string> {
    await new Promise<void>((resolve) => this.server.listen(port, "127.0.0.1", resolve));
    this.timer = setInterval(() => this.send(), 1000 / 60);
    return `http://127.0.0.1:${(this.server.address() as AddressInfo).port}/`;
  }

  async stop(): Promise<void> {
    clearInterval(this.timer);
    this.cut();
    await new Promise((resolve) => this.server.close(resolve));
  }

  cut(): void {
    for (const client of this.clients) client.socket.destroy();
    this.clients.clear();
  }

  set<N extends RecordName>(name: N, value: Partial<RecordOf<N>>, key = ""): void {
    this.others.set(`${name} ${key}`, record(name, value) as TestRecord);
  }

  now_ms(): number {
    return performance.now() + 1e6;
  }

  private answer(request: IncomingMessage, response: ServerResponse): void {
    const path = (request.url ?? "/").split("?")[0];
    response.setHeader("Content-Security-Policy", kPolicy);
    if (path === "/case") {
      response.setHeader("Content-Type", "application/json").end(JSON.stringify(this.case_.json));
      return;
    }
    const file = this.case_.files.get(path);
    if (file) {
      response.end(file);
      return;
    }
    const name = join(this.page, path === "/" ? "index.html" : path);
    if (!existsSync(name)) {
      response.writeHead(404, { "Content-Type": "application/json" }).end('{"error": "not here"}');
      return;
    }
    response.setHeader("Content-Type", kTypes[name.split(".").at(-1) ?? ""] ?? "application/octet-stream");
    createReadStream(name).pipe(response);
  }

  private upgrade(request: IncomingMessage, socket: Duplex): void {
    const key = `${request.headers["sec-websocket-key"]}258EAFA5-E914-47DA-95CA-C5AB0DC85B11`;
    const accept = createHash("sha1").update(key).digest("base64");
    socket.write(
      `HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: ${accept}\r\n\r\n`,
    );
    const client: Client = { socket, acknowledged: true, pongs: [] };
    this.clients.add(client);
    let rest: Buffer = Buffer.alloc(0);
    socket.on("data", (data: Buffer) => {
      rest = this.read(client, Buffer.concat([rest, data]));
    });
    socket.on("error", () => this.clients.delete(client));
    socket.on("close", () => this.clients.delete(client));
  }

  // Requests are 16 bytes, masked, in one frame of their own: 2 + 4 + 16 bytes. Returns what is not whole yet.
  private read(client: Client, received: Buffer): Buffer {
    let data = Buffer.from(received);
    while (data.length >= 6) {
      const length = data[1] & 0x7f;
      if (data.length < 6 + length) break;
      if (length === 16) this.request(client, Buffer.from(data.subarray(6, 22).map((b, i) => b ^ data[2 + (i % 4)])));
      data = data.subarray(6 + length);
    }
    return data;
  }

  private request(client: Client, request: Buffer): void {
    const kind = request.readUInt32LE(0);
    if (kind === 1) client.acknowledged = true;
    if (kind === 3 && !this.paused)
      client.pongs.push({ client_ms: request.readDoubleLE(8), received_ms: this.now_ms() });
  }

  private send(): void {
    if (this.paused) return;
    for (const client of this.clients) {
      if (!client.acknowledged) continue;
      client.acknowledged = false;
      const now = this.now_ms();
      const pongs = client.pongs.map((p) => record("pong", { ...p, written_ms: now }));
      client.pongs = [];
      this.write(client, encodeFrame(++this.frame, now, [...pongs, ...this.records(now)]));
    }
  }

  private records(now_ms: number): TestRecord[] {
    if (!this.frozen) this.frozenAt_ms = now_ms;
    const at = this.frozenAt_ms;
    return [
      record("link", {
        silent_ms: 10,
        last_state_ms: at - 4,
        presence: 2,
        wire_generation: 2,
        wire_revision: 2,
        host: "test",
        ...this.link,
      }),
      record("case", { fraction: 1, state: 3, hash: kHash, id: "spheres", ...this.case }),
      record("session", { session: 6, time_ms: at, next: "Advance the probe to the target." }),
      record("tool", this.tool(at)),
      ...this.others.values(),
    ] as TestRecord[];
  }

  private write(client: Client, frame: ArrayBuffer): void {
    const head = Buffer.from([0x82, 126, 0, 0]);
    head.writeUInt16BE(frame.byteLength, 2);
    client.socket.write(Buffer.concat([head, Buffer.from(frame)]));
  }
}

// The probe on its plan, moving slowly to and fro.
export function insertion(now_ms: number, fraction = 0.5 + 0.3 * Math.sin(now_ms / 2000)): RecordOf<"tool"> {
  const direction = kTarget.map((t, d) => t - kEntry[d]);
  const length = Math.hypot(...direction);
  const [x, y, z] = direction.map((d) => -d / length); // the tool's axis is -x
  // Columns: x, and two at right angles to it.
  const s = Math.hypot(x, y);
  const rotation = [x, -y / s, -(x * z) / s, y, x / s, -(y * z) / s, z, 0, s];
  return {
    ...liveTool(now_ms),
    rotation,
    tip_mm: kEntry.map((e, d) => e + fraction * direction[d]),
    trajectory: "Plan",
    remaining_depth_mm: (1 - fraction) * length,
    nearest_structure: "Vessel",
    nearest_structure_mm: 7.4,
    nearest_structure_sigma_mm: 0.4,
    tre_95_semi_axes_mm: [3, 2, 1.2],
    predicted_target_mm: kTarget as unknown as number[],
  };
}
