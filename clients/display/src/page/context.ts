// What the parts of the page show: one object, filled once per draw.
import type { CaseData } from "../state/case_data.ts";
import type { Store } from "../state/store.ts";
import type { Scene } from "../view/scene.ts";
import type { ViewState } from "../view/view_state.ts";

export interface PageContext {
  readonly store: Store;
  readonly data: CaseData;
  readonly scene: Scene;
  readonly view: ViewState;
  readonly gateway_ms: number;
}

// A part of the page: an element that is brought up to date by update().
export interface Part {
  readonly element: HTMLElement;
  update(context: PageContext): void;
}
