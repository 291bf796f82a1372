// Where the tip of the followed tool was in the last seconds.
import type { Vec3 } from "../geometry/vector.ts";
import type { SceneTool } from "./scene.ts";

const kKept_ms = 5000;

export class TipTrace {
  private samples: { at_ms: number; tip: Vec3 }[] = [];
  private of = ""; // whose they are

  // Nothing without a tool that may be shown. It begins anew with another tool, or when the tool becomes verified.
  update(now_ms: number, tool: SceneTool | null): Vec3[] {
    if (!tool) return [];
    const of = `${tool.name} ${tool.verified}`;
    if (of !== this.of) this.clear();
    this.of = of;
    this.samples = this.samples.filter((s) => now_ms - s.at_ms < kKept_ms);
    this.samples.push({ at_ms: now_ms, tip: tool.tip });
    return this.samples.map((s) => s.tip);
  }

  clear(): void {
    this.samples = [];
  }
}
