// What the parts of the page show: one object, filled once per draw.
import type { CaseData } from "../state/case_data.ts";
import type { Store } from "../state/store.ts";
import type { Scene } from "../view/scene.ts";
import type { ViewState } from "../view/view_state.ts";

export interface StateContext {
  readonly store: Store;
  readonly data: CaseData | null; // null: no case is loaded
  readonly gateway_ms: number;
}

export interface PageContext extends StateContext {
  readonly data: CaseData;
  readonly scene: Scene;
  readonly view: ViewState;
}

// A part of the page: an element that is brought up to date by update().
export interface Part {
  readonly element: HTMLElement;
  update(context: PageContext): void;
}

// One that says something without a case as well.
export interface CaselessPart extends Part {
  update(context: StateContext): void;
}
