// What the studio's server tells the page: web/state.py, web/studio_folder.py; and what views get from main.js.

interface Term { kind: string; picture?: string | null; words?: string | null; weight: number }
interface Wish {
  title: string; terms: Term[]; initial: Term[]; strokes: number; colors: number; width: number; height: number;
  brushes: string; replans: number; ground: string | null; on_canvas: boolean; focus: "faces" | "subject" | "none"; sharpness: number; drying: number; minutes: number | null; effort: number; seed: number;
}
interface Paint { number: number; hex: string; strokes: number; share: number }
interface Mixture { recipe: string; millilitres: number; near: boolean }
interface Made { prefix: string; frames: number[]; strokes: number; palette: Paint[]; mixtures: Mixture[]; seconds: number }
interface PlanState {
  number: number; wish: Wish; status: "waiting" | "planning" | "ready" | "failed" | "stopped"; share: number; left: number | null;
  growing: string | null; nearer: number; made: Made | null;
}
interface Look { done: number; seen: string; expected: string; difference: string; why: string; gain?: number; touch?: string[]; plan?: string }
interface PaintState {
  plan: number; of: number; status: string; done: number; left: number | null; dries: number; photograph: string | null; growing: string | null;
  brush: string; paint: number | null; dips: Record<number, number>; since_dip: number; reason: string; looks: Look[];
  replanned: (Omit<Made, "mixtures" | "seconds"> & { done: number }) | null; held: boolean; turn: boolean; turns: number;
  region: { picture: string; only: boolean } | null; remark: string; wish: Wish | null; film: boolean; arm: boolean; kept: boolean;
}
interface State {
  version: number; working: boolean; stopped: boolean; queued: "" | "plan" | "paint"; trouble: string; question: any; plans: PlanState[]; painting: PaintState | null;
}
interface Strokes { height: number; paths: number[][][]; widths: number[]; paint: number[] }
interface House {
  notice(sentence: string, label?: string, work?: () => void): void;
  attempt<T>(work: () => Promise<T>): Promise<T | undefined>;
  connected(there: boolean): void;
  active(working: boolean): void;
  refresh(): Promise<void>;
  entered(element: HTMLElement): void;
  readonly work: import("../../src/frida_painter/web/static/queue.js").WorkWatch;
  readonly abilities: Record<string, { ready: boolean; missing: string[]; fetch: string[]; advice: string }>;
  readonly role: "watch" | "plan" | "operate";
  readonly simulated: boolean;
  readonly robot: string;
  readonly camera: boolean;
  readonly canvas: [number, number] | null;
  readonly pace: import("../../src/frida_painter/web/static/estimate.js").Pace;
}
interface Here { readonly id: string; readonly title: string; go(step: string): void }
