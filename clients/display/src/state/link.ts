// The socket to bregma-gateway: frames, acknowledgements, pings, and a new connection when it is lost or silent.
import { GatewayClock, type LocalTime } from "./clock.ts";
import { decodeFrame, type Frame } from "./frame.ts";
import type { RecordOf } from "./layout.ts";

export const localTime = (): LocalTime => ({ timer_ms: performance.now(), wall_ms: Date.now() });

// By whichever of the two clocks says more.
export function elapsed_ms(since: LocalTime, now: LocalTime): number {
  return Math.max(now.timer_ms - since.timer_ms, now.wall_ms - since.wall_ms);
}

const kRequest = { acknowledge: 1, rate: 2, ping: 3, field: 4, slices: 5 } as const;
const kReconnect_ms = 200;
const kSilence_ms = 2000; // then another connection is tried
const kPing_ms = 1000;
const kFirstPings = 4; // in quick succession after the connection

export interface LinkListener {
  // A frame was decoded; `first`: it has everything, and all before it is void.
  frame(frame: Frame, first: boolean): void;
  // The text is for the operator.
  failed(text: string): void;
}

export class StateLink {
  readonly clock = new GatewayClock();
  // Since when the gateway owes a frame: the arrival of the latest one, or its acknowledgement after a long draw.
  owedSince: LocalTime | null = null;
  bytes = 0; // received in all
  private socket: WebSocket | null = null;
  private began: LocalTime = localTime();
  private first = true;
  private unacknowledged: number | null = null;
  private sentPings = new Map<number, LocalTime>();
  private pings = 0;
  private lastPing: LocalTime | null = null;
  private field = false;
  private slices = false;

  constructor(
    private readonly url: string,
    private readonly listener: LinkListener,
  ) {
    this.connect();
    setInterval(() => this.watch(), kReconnect_ms);
  }

  // The gateway's clock now; NaN while it is not known.
  now_ms(): number {
    return this.clock.at(localTime());
  }

  // The latest frame was used: the gateway may send the next.
  acknowledge(): void {
    if (this.unacknowledged === null) return;
    this.request(kRequest.acknowledge, this.unacknowledged);
    this.owedSince = localTime();
    this.unacknowledged = null;
  }

  get waiting(): boolean {
    return this.unacknowledged !== null;
  }

  requestField(on: boolean): void {
    if (on === this.field) return;
    this.field = on;
    this.request(kRequest.field, on ? 1 : 0);
  }

  requestSlices(on: boolean): void {
    if (on === this.slices) return;
    this.slices = on;
    this.request(kRequest.slices, on ? 1 : 0);
  }

  ping(): void {
    const sent = localTime();
    this.lastPing = sent;
    ++this.pings;
    this.sentPings.set(sent.timer_ms, sent);
    if (this.sentPings.size > 32) this.sentPings.delete(this.sentPings.keys().next().value as number);
    this.request(kRequest.ping, 0, sent.timer_ms);
  }

  // Whatever is known of the gateway's clock may be wrong: after a sleep.
  remeasure(): void {
    this.clock.forget();
    this.sentPings.clear();
    this.ping();
  }

  private connect(): void {
    this.drop();
    this.began = localTime();
    this.first = true;
    this.pings = 0;
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    const mine = (f: () => void) => () => {
      if (this.socket === socket) f();
    };
    socket.onopen = mine(() => {
      this.clock.forget();
      this.sentPings.clear();
      this.ping();
      if (this.field) this.request(kRequest.field, 1);
      if (this.slices) this.request(kRequest.slices, 1);
    });
    socket.onmessage = (event) => {
      if (this.socket === socket && event.data instanceof ArrayBuffer) this.take(event.data);
    };
    socket.onclose = mine(() => {
      this.socket = null;
    });
  }

  private drop(): void {
    const socket = this.socket;
    this.socket = null;
    this.unacknowledged = null;
    socket?.close();
  }

  private take(data: ArrayBuffer): void {
    const arrived = localTime();
    let frame: Frame;
    try {
      frame = decodeFrame(data);
    } catch (error) {
      this.listener.failed(`A frame of bregma-gateway cannot be read: ${(error as Error).message}.`);
      this.drop();
      return;
    }
    this.bytes += data.byteLength;
    this.owedSince = arrived;
    this.unacknowledged = frame.number;
    for (const record of frame.records) {
      if (record.name === "pong") this.pong(record.value as RecordOf<"pong">, arrived);
    }
    const first = this.first;
    this.first = false;
    if (this.pings < kFirstPings) this.ping();
    this.listener.frame(frame, first);
  }

  private pong(pong: RecordOf<"pong">, arrived: LocalTime): void {
    const sent = this.sentPings.get(pong.client_ms);
    if (!sent) return;
    this.sentPings.delete(pong.client_ms);
    this.clock.add({ sent, arrived, received_ms: pong.received_ms, written_ms: pong.written_ms });
  }

  private watch(): void {
    const now = localTime();
    if (!this.socket) {
      this.connect();
      return;
    }
    const since = this.owedSince && !this.first ? this.owedSince : this.began;
    if (elapsed_ms(since, now) > kSilence_ms) {
      this.connect();
      return;
    }
    if (!this.lastPing || elapsed_ms(this.lastPing, now) > kPing_ms) this.ping();
  }

  private request(kind: number, value: number, client_ms = 0): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    const message = new DataView(new ArrayBuffer(16));
    message.setUint32(0, kind, true);
    message.setUint32(4, value, true);
    message.setFloat64(8, client_ms, true);
    this.socket.send(message.buffer);
  }
}
