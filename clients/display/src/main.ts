import { App } from "./page/app.ts";

const root = document.getElementById("app") as HTMLElement;
const app = new App(root);
// For tests and measurements: nothing of it reaches the daemon.
(globalThis as unknown as { bregma: App }).bregma = app;
