// What the studio's server tells the page: painting_state.py, jobs.py, studio_folder.py; and what views get from main.js.

interface Term { kind: string; picture?: string | null; words?: string | null; weight: number; crop?: number[] | null; made?: string | null }
/** Settings of the form by their names; a size is what the time depends on. */
type Settings = import("../../src/frida_painter_studio/static/estimate.js").Size & Record<string, any>;
/** What a person asks for: goals, the sides of the canvas in mm, and settings. */
type Wish = Settings & { title: string; variant?: string; terms: Term[]; initial: Term[]; width: number; height: number };
/** A choice: what it sets, and the name of its picture. */
interface Choice { label: string; title: string; picture: string | null; sets: Record<string, any> }
/** A control of the form: "first", "more" or the kind of goal that it stands beside; values of a slider with their words. */
interface Control {
  name: string; label: string; kind: "slider" | "choices" | "number" | "brushes" | "canvas" | "families" | "goals" | "ground" | "words"; help: string;
  level: string; group: string; range: { ge: number; le: number }; steps: [number | null, string][]; options: Choice[];
} // form.py
interface Paint { number: number; hex: string; strokes: number; share: number }
interface Mixture { well: number; hex: string; recipe: string; amount: string; also: string; near: boolean }
interface BrushPaints { title: string; mixtures: Mixture[] }
interface Made { prefix: string; nearer: number; frames: number[]; strokes: number; palette: Paint[]; brushes?: BrushPaints[]; shopping: string[]; mixing?: Record<string, string>; seconds: number }
interface PlanState {
  number: number; wish: Wish; status: "waiting" | "planning" | "ready" | "failed" | "stopped"; share: number; left: number | null; said: string;
  growing: string | null; made: Made | null; beside: boolean;
}
// The records of session/fold.py and events.py, under their names.
interface Planned { done: number; strokes: number; loss_before: number; loss_after: number; look: string; shown: Omit<Made, "nearer" | "mixtures" | "seconds"> }
interface Look { done: number; pictures: { seen: string; expected: string; difference: string }; why: string; planned: Planned | null; touch: string[]; found: string }
interface Turns { strokes: number; minutes: number; policy: string; keep: "welcome" | "protect" }
interface PersonBrush { name: string; light: number; hard: number }
interface PaintState {
  plan: number; status: string; said: string; left: number | null;
  progress: { painted: number; of: number; drying: { left: number } | null; pace: number };
  brush: { name: string; paint: number | null; since_dip: number; dips: Record<number, number> };
  planning: { replanned: Planned | null; growing: string | null };
  pictures: { photograph: string | null; looks: Look[] };
  wishes: {
    goals: { wish: { terms?: Term[]; initial?: Term[] } }[]; request: { kind?: string; words?: string }; proposed: Making | null; region: { drawing: string; only: boolean } | null;
    turns: Turns; pause: { reason: string; cause: "person" | "button" | "turn" | "trouble" } | null; paused: boolean;
  };
  people: { remark: string; may_paint: { brushes: PersonBrush[]; wells: string[] } | null; painted: number };
  end: { results: string[] | null };
}
interface State {
  stage: "waiting" | "planning" | "plan stopped" | "plan failed" | "planned" | "queued" | "preparing" | "mixing" | "painting" | "drying" | "replanning"
    | "paused" | "finishing" | "finished" | "stopped" | "failed" | "lost" | "reading"; // reading: a card only
  resumable: boolean; version: number; working: boolean; stopped: boolean; trouble: string; question: any; plans: PlanState[]; painting: PaintState | null;
}
type Command = { kind: "pause" | "go on" | "finish" | "look" | "free" } | { kind: "leave out"; count: number } | { kind: "turns"; count: number; minutes?: number; policy?: string; keep?: string }
  | { kind: "propose"; words: string; maker: string } | { kind: "end making" } | { kind: "protect"; picture: string; only: boolean } | { kind: "picture"; picture: string } | { kind: "goal"; terms: Term[]; initial: Term[] }
  | { kind: "paint"; brush: string; paint: number; points: number[][] }; // commands.py
interface Strokes { height: number; paths: number[][][]; widths: number[]; paint: number[] }
interface Ability { ready: boolean; missing: string[]; fetch: string[]; advice: string; label: string; verb: string; words: boolean } // web_studio.py
interface Making { words: string; maker: string; pictures: { picture: string; seed: number }[]; best: number; rule: string; faults: string[] }
interface ImaginingState { version: number; working: boolean; words: string; maker: string; progress: string; stopped: boolean; trouble: string; makings: Making[] } // jobs.py
interface House {
  notice(sentence: string, label?: string, work?: () => void): void;
  attempt<T>(work: () => Promise<T>): Promise<T | undefined>;
  connected(there: boolean, sentence?: string): void;
  active(working: boolean): void;
  refresh(): Promise<void>;
  entered(element: HTMLElement): void;
  readonly work: import("../../src/frida_painter_studio/static/queue.js").WorkWatch;
  readonly abilities: Record<string, Ability>;
  readonly role: "watch" | "plan" | "operate";
  readonly simulated: boolean;
  /** True if a machine could hurt somebody. */
  readonly dangerous: boolean;
  readonly robot: string;
  readonly camera: boolean;
  /** False if no camera looks at the canvas, so that every picture of it shows what is expected. */
  readonly watched: boolean;
  readonly canvas: [number, number] | null;
  /** What the form asks for, and what is usual. */
  readonly form: { usual: Settings; controls: Control[] };
  /** Names of the variants of a plan. */
  readonly variants: string[];
  /** Labels of the picture makers that whoever opened the studio allowed. */
  readonly makers: string[];
  /** Names of the ways in which the robot can answer a person's turn. */
  readonly turns: string[];
  readonly pace: import("../../src/frida_painter_studio/static/estimate.js").Pace;
}
interface Here { readonly id: string; readonly title: string; readonly begun: string; go(step: string): void }
