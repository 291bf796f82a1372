// How the traced points are spread over the head, by their direction from its middle.
import type { Vec3 } from "../geometry/vector.ts";

export const kRegions = ["in front", "on the right", "on the left", "on top", "behind"] as const;
export type Region = (typeof kRegions)[number];

const kDirections: Readonly<Record<Region, Vec3>> = {
  "in front": [0, 1, 0],
  "on the right": [1, 0, 0],
  "on the left": [-1, 0, 0],
  "on top": [0, 0, 1],
  behind: [0, -1, 0],
};

export type Coverage = Readonly<Record<Region, number>>;

// Points per region; `fromMiddle` are the points less the middle of the head.
export function coverageOf(fromMiddle: readonly Vec3[]): Coverage {
  const counts: Record<Region, number> = { "in front": 0, "on the right": 0, "on the left": 0, "on top": 0, behind: 0 };
  for (const p of fromMiddle) {
    let best: Region = kRegions[0];
    const along = (region: Region) => {
      const d = kDirections[region];
      return d[0] * p[0] + d[1] * p[1] + d[2] * p[2];
    };
    for (const region of kRegions) if (along(region) > along(best)) best = region;
    ++counts[best];
  }
  return counts;
}

// The region that a trace should visit next. The back of a lying patient cannot be reached and is not asked for. Null once
// every other region has a tenth of all points.
export function leastCovered(coverage: Coverage): Region | null {
  const total = Object.values(coverage).reduce((sum, n) => sum + n, 0);
  const wanted = kRegions.filter((region) => region !== "behind");
  const least = wanted.reduce((a, b) => (coverage[b] < coverage[a] ? b : a));
  return total > 0 && coverage[least] >= total / 10 ? null : least;
}
