import { App } from "./page/app.ts";
import { CoverView } from "./page/cover_view.ts";

const root = document.getElementById("app") as HTMLElement;
try {
  const app = new App(root);
  // For tests and measurements: nothing of it reaches the daemon.
  (globalThis as unknown as { bregma: App }).bregma = app;
} catch (error) {
  const cover = new CoverView();
  cover.show({ title: "This browser cannot draw", text: `${(error as Error).message}.` });
  root.append(cover.element);
  throw error;
}
