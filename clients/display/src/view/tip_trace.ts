// Where the tip was in the last seconds.
import type { Vec3 } from "../geometry/vector.ts";

const kKept_ms = 5000;

export class TipTrace {
  private samples: { at_ms: number; tip: Vec3 }[] = [];

  add(at_ms: number, tip: Vec3): void {
    this.samples.push({ at_ms, tip });
  }

  points(now_ms: number): Vec3[] {
    this.samples = this.samples.filter((s) => now_ms - s.at_ms < kKept_ms);
    return this.samples.map((s) => s.tip);
  }

  clear(): void {
    this.samples = [];
  }
}
