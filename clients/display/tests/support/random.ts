// Random numbers from a fixed seed (mulberry32), so that every run is the same.
import type { Mat3, Vec3 } from "../../src/geometry/vector.ts";
import { cross, perpendicular, unit } from "../../src/geometry/vector.ts";

export class Random {
  constructor(private state: number) {}

  uniform(): number {
    this.state = (this.state + 0x6d2b79f5) | 0;
    let t = Math.imul(this.state ^ (this.state >>> 15), 1 | this.state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  }

  between(low: number, high: number): number {
    return low + (high - low) * this.uniform();
  }

  integer(below: number): number {
    return Math.floor(this.uniform() * below);
  }

  // Standard normal (Box and Muller).
  normal(): number {
    return Math.sqrt(-2 * Math.log(1 - this.uniform())) * Math.cos(2 * Math.PI * this.uniform());
  }

  normal3(): Vec3 {
    return [this.normal(), this.normal(), this.normal()];
  }

  direction(): Vec3 {
    return unit(this.normal3());
  }

  // Rows: a right-handed system of unit vectors.
  rotation(): Mat3 {
    const a = this.direction();
    const b = perpendicular(a, this.direction());
    return [...a, ...b, ...cross(a, b)] as unknown as Mat3;
  }
}
