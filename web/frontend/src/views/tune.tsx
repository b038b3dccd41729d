// Tune: staged edits against the live set, with poles, margins and steps of both before anything is sent.

import type { JSX } from "preact";
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { undoGains } from "../actions";
import { send, StationError } from "../api";
import { Key, Segments } from "../controls";
import { type DesignReport, type DesignWarning, type GainTables, loadGains, type Prediction, useDesign } from "../design";
import { type FlownStep, flownStep } from "../flown_step";
import { useClock } from "../frame_loop";
import type { Answer, ControllerKind, GainRow } from "../protocol";
import { airborne, holdsControls, say, useStore } from "../store";
import { type Staged, stagedOf, type Texts } from "../staged";
import { type Group, GROUPS, LOOP_NAMES, LOOPS, title } from "../tune_groups";
import { ControllerSwitch } from "./manoeuvre";
import { TuneCheck } from "./tune_check";
import { EditFoot, EditTable, GainsFromWeights } from "./tune_edit";
import { TuneHistory } from "./tune_history";
import { TuneMargins } from "./tune_margins";
import { TunePoles } from "./tune_poles";
import { TuneSteps } from "./tune_steps";

function useTables(gainSet: number): GainTables | null {
  const [tables, setTables] = useState<GainTables | null>(null);
  const live = useStore((s) => s.station === "live" && s.session !== null);
  useEffect(() => {
    if (!live) return;
    loadGains().then(setTables).catch((error: unknown) => {
      if (!(error instanceof StationError)) throw error;
      say("caution", error.message);
    });
  }, [gainSet, live]);
  return tables;
}

// A flown step is searched once a second: it costs a walk over the ring.
function useFlown(loop: string, prediction: Prediction | null): FlownStep | null {
  const now = useClock(1000);
  const step = prediction?.live.loops.find((l) => l.name === loop)?.step;
  const found = step ? flownStep(loop, step.size, step.time_s[step.time_s.length - 1] ?? 8) : null;
  const stamp = found ? `${found.startS} ${found.time_s.length}` : "";
  return useMemo(() => found, [stamp, loop, now > 0 && step?.size]);
}

function editedLoops(table: GainRow[], staged: Staged): string[] {
  return table.filter((row) => row.key in staged.changes).flatMap((row) => LOOPS[row.group as Group] ?? []);
}

interface Guard {
  blocked: string;
  caution: string;
}

function guard(staged: Staged, prediction: Prediction | null, problem: string, moved: boolean, hold: boolean, loops: string[]): Guard {
  const typed = Object.values(staged.problems)[0];
  if (typed) return { blocked: `Refused: ${typed}.`, caution: "" };
  if (Object.keys(staged.changes).length === 0) return { blocked: "", caution: "" };
  if (problem) return { blocked: `Refused: ${problem}`, caution: "" };
  if (moved) return { blocked: "Live values changed under these edits. Discard, or keep them against the new set.", caution: "" };
  const report = prediction?.staged;
  if (report && report.stable === false) return { blocked: "Refused: staged poles are unstable. Lower the change until all are left of 0.", caution: "" };
  // Limits of the loops that are edited, and those that the edit newly breaks elsewhere.
  const known = (w: DesignWarning): boolean => prediction?.live.warnings.some((l) => l.loop === w.loop && l.quantity === w.quantity) ?? false;
  const broken = report?.warnings.filter((w) => loops.includes(w.loop) || !known(w)) ?? [];
  const [first] = broken;
  if (!first) return { blocked: "", caution: "" };
  return { blocked: "", caution: `Staged: ${first.text}${broken.length > 1 ? ` And ${broken.length - 1} more.` : ""}${hold ? " Apply needs a 0.8 s press." : ""}` };
}

function useStaging(gainSet: number): { texts: Texts; set: (key: string, text: string | null) => void; clear: () => void; moved: boolean; keep: () => void } {
  const [texts, setTexts] = useState<Texts>({});
  const base = useRef(gainSet);
  const empty = Object.keys(texts).length === 0;
  if (empty) base.current = gainSet;
  const [, again] = useState(0);
  return {
    texts,
    set: (key, text) => setTexts((old) => {
      const { [key]: _gone, ...rest } = old;
      return text === null ? rest : { ...rest, [key]: text };
    }),
    clear: () => setTexts({}),
    moved: base.current !== gainSet,
    keep: () => { base.current = gainSet; again((n) => n + 1); },
  };
}

interface Tuning {
  kind: ControllerKind | null;
  own: GainTables["controllers"]["lqr"] | null;
  gainSet: number;
  staging: ReturnType<typeof useStaging>;
  staged: Staged;
  count: number;
  ready: boolean;
  tookMs: number;
  problem: string;
  prediction: Prediction | null;
  live: DesignReport | null;
  next: DesignReport | null;
}

// The live set, what is staged on it, and the station's prediction of both.
function useTuning(): Tuning {
  const kind = useStore((s) => s.status?.controller ?? null);
  const gainSet = useStore((s) => s.status?.gain_set ?? 0);
  const tables = useTables(gainSet);
  const staging = useStaging(gainSet);
  const own = kind && tables ? tables.controllers[kind] : null;
  const staged = useMemo(() => stagedOf(staging.texts, own?.newest.values ?? {}, own?.table ?? []), [staging.texts, own]);
  const count = Object.keys(staged.changes).length;
  const design = useDesign(kind, staged.changes, gainSet);
  const prediction = design.prediction?.controller === kind ? design.prediction : null;
  return {
    kind, own, gainSet, staging, staged, count, prediction,
    ready: design.fresh && prediction !== null, tookMs: design.tookMs, problem: design.problem,
    live: prediction?.live ?? null, next: count > 0 ? (prediction?.staged ?? null) : null,
  };
}

function Foot({ tuning, refused, setRefused }: { tuning: Tuning; refused: string; setRefused: (text: string) => void }): JSX.Element {
  const { staging, staged, count, prediction, gainSet, own } = tuning;
  const [why, setWhy] = useState("");
  const canUndo = useStore((s) => (s.status?.gain_history.length ?? 0) > 1);
  const mine = useStore(holdsControls);
  const hold = useStore(airborne);
  const { blocked, caution } = guard(staged, prediction, tuning.problem, staging.moved, hold, editedLoops(own?.table ?? [], staged));
  const answered = (answer: Answer): boolean => {
    setRefused(answer.accepted ? "" : `Refused: ${answer.reason}`);
    return answer.accepted;
  };
  const apply = (): void => {
    void send({ type: "apply_gains", changes: staged.changes, why: why.trim() }).then((answer) => {
      if (!answered(answer)) return;
      staging.clear();
      setWhy("");
      say("advisory", count === 1 ? "1 edit applied." : `${count} edits applied.`);
    });
  };
  const undo = (): void => void undoGains().then(answered);
  const discard = (): void => { staging.clear(); setRefused(""); };
  useEffect(() => {
    window.addEventListener("undo-gains", undo);
    return () => window.removeEventListener("undo-gains", undo);
  }, []);
  return (
    <>
      {staging.moved && count > 0 && <div class="keys moved"><Key testid="tune-keep" onAct={staging.keep}>{`Keep edits against set ${gainSet}`}</Key></div>}
      <EditFoot count={count} why={why} onWhy={setWhy} mine={mine} hold={hold} blocked={blocked} caution={caution} refused={refused}
        ready={tuning.ready} jump={count > 0 ? (prediction?.jump ?? null) : null} gainSet={gainSet} canUndo={canUndo} onApply={apply} onDiscard={discard} onUndo={undo} />
    </>
  );
}

interface EditProps {
  tuning: Tuning;
  group: Group;
  onGroup: (group: Group) => void;
  loop: string;
  flown: FlownStep | null;
}

function EditColumn({ tuning, group, onGroup, loop, flown }: EditProps): JSX.Element {
  const { kind, own, staging, staged, prediction, count } = tuning;
  const [refused, setRefused] = useState("");
  useEffect(() => setRefused(""), [kind, staging.texts]);
  useEffect(() => {
    const find = (): void => document.querySelector<HTMLInputElement>(".edit-table input")?.focus();
    window.addEventListener("find-field", find);
    return () => window.removeEventListener("find-field", find);
  }, []);
  return (
    <section class="panel edit">
      <div class="tabs" role="tablist">
        {GROUPS.map((name) => (
          <button type="button" role="tab" key={name} data-testid={`tune-tab-${name}`} aria-selected={group === name} onClick={() => onGroup(name)}>{title(name)}</button>
        ))}
      </div>
      <div class="scroll">
        <header class="head"><h2>{kind === "pid" ? "Gains" : "Weights"}</h2><span class="right"><ControllerSwitch onRefused={setRefused} /></span></header>
        {own
          ? <EditTable rows={own.table.filter((row) => row.group === group)} live={own.newest.values} texts={staging.texts} staged={staged} weights={kind === "lqr"} onText={staging.set} />
          : <p class="empty"><b>No gain set yet.</b>The live set appears when the flight process reports its status.</p>}
        {kind === "lqr" && <GainsFromWeights group={group} prediction={prediction} edits={count > 0} />}
        <TuneCheck loop={loop} step={tuning.live?.loops.find((l) => l.name === loop)?.step} flown={flown} />
      </div>
      <Foot tuning={tuning} refused={refused} setRefused={setRefused} />
    </section>
  );
}

const AXES = ["x", "y"].map((value) => ({ value, text: LOOP_NAMES[value] ?? value }));

export function TuneView(): JSX.Element {
  const [group, setGroup] = useState<Group>("roll");
  const [axis, setAxis] = useState("x");
  const tuning = useTuning();
  const { live, next } = tuning;
  const loop = group === "position" ? axis : (LOOPS[group][0] ?? "roll");
  const flown = useFlown(loop, tuning.prediction);
  const of = (report: DesignReport | null) => report?.loops.find((l) => l.name === loop);
  return (
    <div class="tune">
      <EditColumn tuning={tuning} group={group} onGroup={setGroup} loop={loop} flown={flown} />
      <div class="middle">
        {group === "position" && <span class="axis-pick"><Segments testid="tune-axis" label="Axis" value={axis} options={AXES} onPick={setAxis} /></span>}
        <TuneSteps loop={loop} live={of(live)} staged={of(next) ?? null} flown={flown} />
        <TuneHistory loop={loop} />
      </div>
      <div class="right-column" data-took={Math.round(tuning.tookMs)} data-testid="tune-design">
        <TunePoles live={live} staged={next} group={group} />
        <TuneMargins loop={loop} live={live} staged={next} flown={flown} />
      </div>
    </div>
  );
}
