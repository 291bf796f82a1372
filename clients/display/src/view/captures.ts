// Captured points in Image with their distance from the skin, computed again when points or registration have changed.
import type { CaseData } from "../state/case_data.ts";
import type { Store } from "../state/store.ts";
import { capturesInImage, isSurface, type SceneCapture } from "./scene.ts";
import { SkinDistance } from "./skin_distance.ts";

export class Captures {
  private skin: SkinDistance | null = null;
  private key = "";
  private points: readonly SceneCapture[] = [];

  setCase(data: CaseData | null): void {
    const scalp = data?.meshes.find((m) => m.kind === "scalp");
    this.skin = scalp ? new SkinDistance(scalp.mesh) : null;
    this.key = "";
    this.points = [];
  }

  update(store: Store): readonly SceneCapture[] {
    const registration = store.all("registration")[0];
    const key = [store.revision("capture"), registration?.accepted_revision, registration?.revision].join(" ");
    if (key === this.key) return this.points;
    this.key = key;
    this.points = capturesInImage(store).map((c) => ({
      position: c.position,
      kind: c.kind,
      distance_mm: isSurface(c) && this.skin ? this.skin.of(c.position) : Number.NaN,
    }));
    return this.points;
  }
}
