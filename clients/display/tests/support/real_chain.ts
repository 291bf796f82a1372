// The real chain on this host: bregmad, the simulated operating room, the case server and bregma-gateway.
import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, openSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kNavigation, kRegistration, kSeed } from "./scenarios.ts";

export interface ChainOptions {
  readonly bin: string; // folder of the programs
  readonly page: string; // folder of the page
  readonly caseFolder: string;
  readonly domain: number;
}

export type ProgramName = "bregmad" | "bregma-sim-room" | "bregma-case-server" | "bregma-gateway";

export class RealChain {
  readonly folder = mkdtempSync(join(tmpdir(), "bregma-chain-"));
  private readonly processes = new Map<ProgramName, ChildProcess>();
  private port = 0;

  constructor(private readonly options: ChainOptions) {
    mkdirSync(join(this.folder, "state"));
    writeFileSync(join(this.folder, "registration.toml"), kRegistration);
    writeFileSync(join(this.folder, "navigation.toml"), kNavigation);
  }

  // Returns the page's address. The session is registered; the operator verifies it, and navigates.
  async start(): Promise<string> {
    const { bin, caseFolder } = this.options;
    const registration = [
      caseFolder,
      join(this.folder, "registration.toml"),
      join(this.folder, "state"),
      String(kSeed),
    ];
    execFileSync(join(bin, "display_registered_session"), registration);
    this.startDaemon();
    this.spawn("bregma-case-server", []);
    await this.startGateway();
    this.startRoom();
    return `http://localhost:${this.port}/`;
  }

  // The operator gives up when a step fails, as where a machine is too busy for the tracker's frames: it can be started again.
  startRoom(): void {
    const { caseFolder } = this.options;
    const scenario = join(this.folder, "navigation.toml");
    this.spawn("bregma-sim-room", ["--case", caseFolder, "--scenario", scenario, "--seed", String(kSeed), "--live"]);
  }

  startDaemon(): void {
    const { domain } = this.options;
    this.spawn(
      "bregmad",
      ["--set", `domain_id=${domain}`, "--set", `state.directory=${join(this.folder, "state")}`],
      false,
    );
  }

  // On the port that it had before, so that a page finds it again.
  async startGateway(): Promise<void> {
    this.spawn("bregma-gateway", [
      "--port",
      String(this.port),
      "--page",
      this.options.page,
      "--cache",
      join(this.folder, "cache"),
    ]);
    for (let i = 0; i < 600 && !this.port; ++i) {
      await new Promise((resolve) => setTimeout(resolve, 50));
      this.port = Number(/http:\/\/[^:]+:(\d+)\//.exec(this.log("bregma-gateway"))?.[1] ?? 0);
    }
    if (!this.port) throw new Error(`bregma-gateway did not start: ${this.log("bregma-gateway")}`);
  }

  signal(name: ProgramName, signal: NodeJS.Signals): void {
    this.processes.get(name)?.kill(signal);
  }

  // The process has ended, and what it locked is free.
  async ended(name: ProgramName): Promise<void> {
    const process = this.processes.get(name);
    if (process) await ended(process);
  }

  pid(name: ProgramName): number {
    return this.processes.get(name)?.pid ?? 0;
  }

  running(name: ProgramName): boolean {
    const process = this.processes.get(name);
    return process !== undefined && process.exitCode === null && process.signalCode === null;
  }

  log(name: ProgramName): string {
    return readFileSync(join(this.folder, `${name}.log`), "utf8");
  }

  async stop(): Promise<void> {
    const all = [...this.processes.values()].reverse();
    for (const process of all) {
      process.kill("SIGCONT");
      process.kill("SIGTERM");
    }
    await Promise.all(all.map(ended));
    rmSync(this.folder, { recursive: true, force: true });
  }

  private spawn(name: ProgramName, args: string[], withDomain = true): void {
    const log = openSync(join(this.folder, `${name}.log`), "a");
    const domain = withDomain ? ["--domain", String(this.options.domain)] : [];
    this.processes.set(
      name,
      spawn(join(this.options.bin, name), [...args, ...domain], { stdio: ["ignore", log, log] }),
    );
  }
}

// A process that does not end on SIGTERM within 5 s is killed.
function ended(process: ChildProcess): Promise<void> {
  if (process.exitCode !== null || process.signalCode !== null) return Promise.resolve();
  return new Promise((resolve) => {
    const timer = setTimeout(() => process.kill("SIGKILL"), 5000);
    process.on("exit", () => {
      clearTimeout(timer);
      resolve();
    });
  });
}
