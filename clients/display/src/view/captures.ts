// Captured points with their distance from the skin: each is computed when it arrives, and all when the registration
// that places them in Image is another one.
import { add, type Mat3, multiply, type Vec3 } from "../geometry/vector.ts";
import type { CaseData } from "../state/case_data.ts";
import { RegistrationStatus } from "../state/constants.ts";
import type { RecordOf } from "../state/layout.ts";
import type { Store } from "../state/store.ts";
import { isSurface, type SceneCapture } from "./scene.ts";
import { SkinDistance } from "./skin_distance.ts";

// What places the points in Image. Those that nothing places are kept in the frame in which they were measured.
export interface PlacedCaptures {
  readonly placedBy: "accepted" | "candidate" | null;
  readonly points: readonly SceneCapture[]; // in Image
  readonly unplaced: readonly Vec3[]; // surface points, in Reference; empty if there is a placement
}

export const kNoCaptures: PlacedCaptures = { placedBy: null, points: [], unplaced: [] };

interface Placement {
  readonly by: "accepted" | "candidate";
  readonly rotation: Mat3;
  readonly translation: Vec3;
}

// The accepted registration, which navigates, else an estimate that is not accepted. A refused one places nothing.
export function placementOf(registration: RecordOf<"registration"> | undefined): Placement | null {
  if (!registration) return null;
  const { status, rotation, translation_mm, accepted_rotation, accepted_translation_mm } = registration;
  const finite = (values: readonly number[]) => values.every(Number.isFinite);
  if (finite([...accepted_rotation, ...accepted_translation_mm])) {
    return {
      by: "accepted",
      rotation: accepted_rotation as unknown as Mat3,
      translation: accepted_translation_mm as unknown as Vec3,
    };
  }
  if (status !== RegistrationStatus.CANDIDATE || !finite([...rotation, ...translation_mm])) return null;
  return {
    by: "candidate",
    rotation: rotation as unknown as Mat3,
    translation: translation_mm as unknown as Vec3,
  };
}

export class Captures {
  private skin: Pick<SkinDistance, "of"> | null = null;
  private key = "";
  private placement = "";
  private placed = kNoCaptures;
  private known = new Map<string, { record: RecordOf<"capture">; shown: SceneCapture }>();

  setCase(data: CaseData | null): void {
    const scalp = data?.meshes.find((m) => m.kind === "scalp");
    this.setSkin(scalp ? new SkinDistance(scalp.mesh) : null);
  }

  setSkin(skin: Pick<SkinDistance, "of"> | null): void {
    this.skin = skin;
    this.key = this.placement = "";
    this.placed = kNoCaptures;
    this.known.clear();
  }

  update(store: Store): PlacedCaptures {
    const placement = placementOf(store.all("registration")[0]);
    const placed = JSON.stringify(placement);
    const key = `${store.revision("capture")} ${placed}`;
    if (key === this.key) return this.placed;
    if (placed !== this.placement) this.known.clear();
    this.key = key;
    this.placement = placed;
    const records = store.all("capture");
    if (placement) {
      this.known = new Map(records.map((record) => [keyOf(record), { record, shown: this.shown(record, placement) }]));
      this.placed = { placedBy: placement.by, points: [...this.known.values()].map((k) => k.shown), unplaced: [] };
    } else {
      const unplaced = records.filter(isSurface).map((c) => c.position_mm as unknown as Vec3);
      this.placed = { placedBy: null, points: [], unplaced };
    }
    return this.placed;
  }

  private shown(record: RecordOf<"capture">, { rotation, translation }: Placement): SceneCapture {
    const before = this.known.get(keyOf(record));
    if (before && isSame(before.record, record)) return before.shown;
    const position = add(multiply(rotation, record.position_mm as unknown as Vec3), translation);
    const distance_mm = isSurface(record) && this.skin ? this.skin.of(position) : Number.NaN;
    return { position, kind: record.kind, distance_mm };
  }
}

const keyOf = (record: RecordOf<"capture">): string => `${record.tool}\n${record.ordinal}`;

const isSame = (a: RecordOf<"capture">, b: RecordOf<"capture">): boolean =>
  a.kind === b.kind && a.position_mm.every((value, d) => value === b.position_mm[d]);
