// The latest record of every instance.
import type { FieldArrays, Frame } from "./frame.ts";
import type { RecordName, RecordOf } from "./layout.ts";

export class Store {
  private readonly kinds = new Map<RecordName, Map<string, RecordOf<RecordName>>>();
  private latestField: FieldArrays | null = null;
  private readonly slices = new Map<string, Uint16Array>();
  private readonly counts = new Map<RecordName, number>();

  apply(frame: Frame): void {
    for (const record of frame.records) {
      this.counts.set(record.name, this.revision(record.name) + 1);
      const instances = this.instances(record.name);
      if (record.ended) instances.delete(record.key);
      else instances.set(record.key, record.value);
      if (record.name === "slice") {
        if (record.pixels && !record.ended) this.slices.set(record.key, record.pixels);
        else this.slices.delete(record.key);
      }
      if (record.name === "field") this.latestField = record.ended ? null : (record.arrays ?? null);
    }
  }

  all<N extends RecordName>(name: N): RecordOf<N>[] {
    return [...this.instances(name).values()] as RecordOf<N>[];
  }

  get<N extends RecordName>(name: N, ...keys: (string | number)[]): RecordOf<N> | null {
    return (this.instances(name).get(keys.join("\n")) as RecordOf<N> | undefined) ?? null;
  }

  // Increases with every record of this kind, so that a view is redone only when its data have changed.
  revision(name: RecordName): number {
    return this.counts.get(name) ?? 0;
  }

  get field(): FieldArrays | null {
    return this.latestField;
  }

  // Pixels of a scanner's slice, row by row.
  pixelsOf(scanner: string): Uint16Array | null {
    return this.slices.get(scanner) ?? null;
  }

  clear(): void {
    for (const name of this.kinds.keys()) this.counts.set(name, this.revision(name) + 1);
    this.kinds.clear();
    this.latestField = null;
    this.slices.clear();
  }

  private instances(name: RecordName): Map<string, RecordOf<RecordName>> {
    let instances = this.kinds.get(name);
    if (!instances) {
      instances = new Map();
      this.kinds.set(name, instances);
    }
    return instances;
  }
}
