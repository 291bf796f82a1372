// The gateway's clock as known to the page, from exchanges of ping and pong (docs/gateway.md).
//
// Two clocks of the browser take part. Its timer (performance.now) may stand still while the computer sleeps; its wall
// clock goes on, but may be set. Whichever says more counts, so that a sleep ends every pose, and a wall clock that is set
// back prolongs none. When the two have moved against each other, earlier exchanges are void.

export interface LocalTime {
  readonly timer_ms: number;
  readonly wall_ms: number;
}

export interface Exchange {
  readonly sent: LocalTime;
  readonly received_ms: number; // gateway clock: arrival of the ping
  readonly written_ms: number; // gateway clock: the pong was written
  readonly arrived: LocalTime;
}

// Movement of the two clocks against each other from which on one of them was set, or stood still.
export const kStep_ms = 20;
const kExchanges = 16;

export class GatewayClock {
  private exchanges: { readonly round_trip_ms: number; readonly offset_ms: number; readonly skew_ms: number }[] = [];

  // False for an exchange during which a clock was set or stood still: it is not used.
  add(exchange: Exchange): boolean {
    const { sent, arrived } = exchange;
    const skew_ms = skewOf(arrived);
    if (Math.abs(skew_ms - skewOf(sent)) > kStep_ms) return false;
    const round_trip_ms = arrived.timer_ms - sent.timer_ms - (exchange.written_ms - exchange.received_ms);
    const offset_ms = (exchange.received_ms - sent.timer_ms + (exchange.written_ms - arrived.timer_ms)) / 2;
    if (!Number.isFinite(offset_ms) || !(round_trip_ms >= -1)) return false;
    this.exchanges = this.exchanges.filter((e) => Math.abs(e.skew_ms - skew_ms) <= kStep_ms).slice(-kExchanges + 1);
    this.exchanges.push({ round_trip_ms, offset_ms, skew_ms });
    return true;
  }

  // The gateway's time at `local`; NaN while it is not known.
  at(local: LocalTime): number {
    const best = this.best();
    if (!best) return Number.NaN;
    const byTimer = local.timer_ms + best.offset_ms;
    const latest = this.exchanges[this.exchanges.length - 1];
    const byWall = local.wall_ms + latest.skew_ms + best.offset_ms;
    return Math.max(byTimer, byWall);
  }

  // How far the two clocks have moved against each other since the latest exchange.
  step_ms(local: LocalTime): number {
    const latest = this.exchanges[this.exchanges.length - 1];
    return latest ? latest.skew_ms - skewOf(local) : 0;
  }

  get round_trip_ms(): number {
    return this.best()?.round_trip_ms ?? Number.NaN;
  }

  // After a new connection, or a sleep: nothing is known.
  forget(): void {
    this.exchanges = [];
  }

  private best() {
    let best = this.exchanges[0];
    for (const e of this.exchanges) if (e.round_trip_ms < best.round_trip_ms) best = e;
    return best;
  }
}

const skewOf = (t: LocalTime): number => t.timer_ms - t.wall_ms;
