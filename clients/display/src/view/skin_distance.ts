// Signed distance of points from a closed surface, positive outside: the triangles near a point are found in a grid of
// cells. The sign is that of the surface's normal at the nearest point; on an edge or a corner that is the mean of the
// triangles there, weighted by their angles (Baerentzen and Aanaes, IEEE TVCG 11, 2005).
import type { Mesh } from "../geometry/mesh_cut.ts";
import { add, cross, distance, dot, norm, scale, sub, unit, type Vec3 } from "../geometry/vector.ts";

const kCell_mm = 8;
const kMaxRings = 6; // farther points are stated as farther than this
const kSame_mm = 1e-6; // triangles that meet in the nearest point are equally far up to rounding

export class SkinDistance {
  private readonly cells = new Map<string, number[]>();

  constructor(private readonly mesh: Mesh) {
    const { triangles } = mesh;
    for (let t = 0; t < triangles.length; t += 3) {
      const corners = [this.vertex(triangles[t]), this.vertex(triangles[t + 1]), this.vertex(triangles[t + 2])];
      const low = cellOf([0, 1, 2].map((d) => Math.min(...corners.map((c) => c[d]))) as unknown as Vec3);
      const high = cellOf([0, 1, 2].map((d) => Math.max(...corners.map((c) => c[d]))) as unknown as Vec3);
      for (let x = low[0]; x <= high[0]; ++x) {
        for (let y = low[1]; y <= high[1]; ++y) for (let z = low[2]; z <= high[2]; ++z) this.put(`${x} ${y} ${z}`, t);
      }
    }
  }

  // Infinity beyond 40 mm.
  of(point: Vec3): number {
    const [cx, cy, cz] = cellOf(point);
    let best = Number.POSITIVE_INFINITY;
    let nearest = new Set<number>();
    for (let ring = 0; ring <= kMaxRings; ++ring) {
      // Cells of this ring are at least (ring - 1) cells away.
      if (best <= (ring - 1) * kCell_mm) break;
      for (let x = -ring; x <= ring; ++x) {
        for (let y = -ring; y <= ring; ++y) {
          for (let z = -ring; z <= ring; ++z) {
            if (Math.max(Math.abs(x), Math.abs(y), Math.abs(z)) !== ring) continue;
            for (const t of this.cells.get(`${cx + x} ${cy + y} ${cz + z}`) ?? []) {
              const mm = distance(point, this.foot(point, t));
              if (mm < best - kSame_mm) nearest = new Set();
              if (mm <= best + kSame_mm) nearest.add(t);
              best = Math.min(best, mm);
            }
          }
        }
      }
    }
    return Number.isFinite(best) && this.isInside(point, nearest) ? -best : best;
  }

  private isInside(point: Vec3, triangles: ReadonlySet<number>): boolean {
    let height = 0;
    for (const t of triangles) {
      const corners = this.corners(t);
      const n = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
      if (!(norm(n) > 0)) continue;
      const foot = this.foot(point, t);
      const at = corners.findIndex((c) => distance(c, foot) < kSame_mm);
      const angle = at < 0 ? Math.PI : angleAt(corners[at], corners[(at + 1) % 3], corners[(at + 2) % 3]);
      height += angle * dot(unit(n), sub(point, foot));
    }
    return height < 0;
  }

  private put(key: string, triangle: number): void {
    const cell = this.cells.get(key);
    if (cell) cell.push(triangle);
    else this.cells.set(key, [triangle]);
  }

  private vertex(i: number): Vec3 {
    const v = this.mesh.vertices_mm;
    return [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
  }

  private corners(t: number): [Vec3, Vec3, Vec3] {
    const { triangles } = this.mesh;
    return [this.vertex(triangles[t]), this.vertex(triangles[t + 1]), this.vertex(triangles[t + 2])];
  }

  // Nearest point of a triangle.
  private foot(p: Vec3, t: number): Vec3 {
    const [a, b, c] = this.corners(t);
    const n = cross(sub(b, a), sub(c, a));
    const area2 = dot(n, n);
    if (area2 > 0) {
      // Barycentric coordinates of the foot on the triangle's plane.
      const wa = dot(cross(sub(c, b), sub(p, b)), n) / area2;
      const wb = dot(cross(sub(a, c), sub(p, c)), n) / area2;
      if (wa >= 0 && wb >= 0 && wa + wb <= 1) return sub(p, scale(n, dot(sub(p, a), n) / area2));
    }
    const feet = [footOnEdge(p, a, b), footOnEdge(p, b, c), footOnEdge(p, c, a)];
    return feet.reduce((best, foot) => (distance(p, foot) < distance(p, best) ? foot : best));
  }
}

const cellOf = (p: Vec3): Vec3 => [
  Math.floor(p[0] / kCell_mm),
  Math.floor(p[1] / kCell_mm),
  Math.floor(p[2] / kCell_mm),
];

function footOnEdge(p: Vec3, a: Vec3, b: Vec3): Vec3 {
  const e = sub(b, a);
  const length2 = dot(e, e);
  const s = length2 > 0 ? Math.min(Math.max(dot(sub(p, a), e) / length2, 0), 1) : 0;
  return add(a, scale(e, s));
}

function angleAt(corner: Vec3, b: Vec3, c: Vec3): number {
  const [u, v] = [unit(sub(b, corner)), unit(sub(c, corner))];
  return Math.acos(Math.min(Math.max(dot(u, v), -1), 1));
}
