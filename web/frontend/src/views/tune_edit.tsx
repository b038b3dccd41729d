// The left column of Tune: staged edits against live, the gains that follow, why, apply, discard, undo.

import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { Key, Symbol } from "../controls";
import type { Prediction } from "../design";
import { figures, fixed, NONE, unitText } from "../format";
import type { GainRow } from "../protocol";
import { changeText, parse, type Staged, type Texts } from "../staged";
import { type Group, MATRIX_GAINS, matrixValue } from "../tune_groups";

interface TableProps {
  rows: GainRow[];
  live: Record<string, number>;
  texts: Texts;
  staged: Staged;
  weights: boolean;
  onText: (key: string, text: string | null) => void;
}

// A typed number keeps the digits a person typed; a live one is written with three figures.
function shownText(texts: Texts, live: Record<string, number>, key: string): string {
  return texts[key] ?? String(+(live[key] ?? NaN).toPrecision(6));
}

function EditRow({ row, live, texts, staged, weights, onText }: TableProps & { row: GainRow }): JSX.Element {
  const edited = row.key in staged.changes;
  const problem = staged.problems[row.key];
  const text = shownText(texts, live, row.key);
  const before = useRef<string | null>(null);
  return (
    <tr>
      <td>{row.label[0]?.toUpperCase() + row.label.slice(1)} <Symbol text={row.symbol} /></td>
      <td data-testid={`live-${row.key}`}>{figures(live[row.key])}</td>
      <td>
        <input class={`field${edited ? " staged" : ""}`} data-testid={`staged-${row.key}`} aria-label={`${row.label}, staged`} aria-invalid={problem !== undefined} title={problem}
          inputMode="decimal" value={text} onFocus={() => { before.current = texts[row.key] ?? null; }}
          onInput={(e) => onText(row.key, e.currentTarget.value)}
          onKeyDown={(e) => { if (e.key === "Escape") { onText(row.key, before.current); e.currentTarget.blur(); } }}
          onBlur={() => { if (texts[row.key] !== undefined && parse(texts[row.key] as string) === live[row.key]) onText(row.key, null); }} />
      </td>
      <td class="unit-cell">{unitText(row.unit)}</td>
      <td class={edited ? "staged" : ""}>{edited ? changeText(live[row.key] ?? NaN, staged.changes[row.key] ?? NaN, weights) : ""}</td>
    </tr>
  );
}

export function EditTable(props: TableProps): JSX.Element {
  return (
    <table class="grid-table edit-table">
      <thead><tr><th>{props.weights ? "Term" : "Gain"}</th><th>Live</th><th>Staged</th><th class="left">Unit</th><th>Change</th></tr></thead>
      <tbody>{props.rows.map((row) => <EditRow key={row.key} row={row} {...props} />)}</tbody>
    </table>
  );
}

// LQR: the gains follow from the weights.
export function GainsFromWeights({ group, prediction, edits }: { group: Group; prediction: Prediction | null; edits: boolean }): JSX.Element {
  return (
    <>
      <header class="head"><h2>Gains</h2><span class="sub">from the weights</span></header>
      <table class="grid-table edit-table">
        <thead><tr><th>Gain</th><th>Live</th><th>Staged</th><th class="left">Unit</th><th>Change</th></tr></thead>
        <tbody>
          {MATRIX_GAINS[group].map((gain) => {
            const live = prediction ? matrixValue(prediction.live.gains, gain) : NaN;
            const staged = prediction && edits ? matrixValue(prediction.staged.gains, gain) : NaN;
            const change = changeText(Number(live.toPrecision(5)), Number(staged.toPrecision(5)), false);
            return (
              <tr key={gain.label}>
                <td>{gain.label} <Symbol text={gain.symbol} /></td><td>{figures(live)}</td>
                <td class={change ? "staged" : ""}>{edits ? figures(staged) : NONE}</td><td class="unit-cell">{gain.unit}</td><td class={change ? "staged" : ""}>{change}</td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </>
  );
}

interface FootProps {
  count: number;
  why: string;
  onWhy: (why: string) => void;
  mine: boolean;
  hold: boolean;
  blocked: string;
  caution: string;
  refused: string;
  ready: boolean;
  jump: Prediction["jump"];
  gainSet: number;
  canUndo: boolean;
  onApply: () => void;
  onDiscard: () => void;
  onUndo: () => void;
}

function applyText(count: number, hold: boolean): string {
  const edits = count === 1 ? "1 edit" : `${count} edits`;
  if (count === 0) return "Apply";
  return hold ? `Hold to apply ${edits}` : `Apply ${edits}`;
}

function bumpless(jump: Prediction["jump"], count: number): string {
  if (count === 0) return "Apply is bumpless: integrators are re-seeded at the switch.";
  if (!jump) return "Bumpless: integrators are re-seeded at the switch. Nothing is commanded now.";
  return `Bumpless: integrators are re-seeded at the switch, predicted jump ${fixed(jump.torque_n_m * 1000, 1)} mN m, ${fixed(jump.thrust_n, 2)} N.`;
}

export function EditFoot(props: FootProps): JSX.Element {
  const { count, why, mine, hold, blocked, caution, refused } = props;
  const whyField = useRef<HTMLInputElement>(null);
  const ready = mine && count > 0 && blocked === "" && props.ready;
  const apply = (): void => {
    if (why.trim() === "") whyField.current?.focus();
    else props.onApply();
  };
  useEffect(() => {
    const listen = (): void => { if (ready) apply(); };
    window.addEventListener("apply-staged", listen);
    return () => window.removeEventListener("apply-staged", listen);
  });
  const said = blocked || refused || caution;
  return (
    <div class="edit-foot">
      {said && <p class={`caution-box${blocked || refused ? " refused" : ""}`} role="status" data-testid="tune-caution">
        <svg class="mark caution" viewBox="0 0 12 12" aria-hidden="true"><path d="M6 1.2 11.2 10.6H.8zM6 4.6v3M6 8.6v.7" /></svg><span>{said}</span></p>}
      <label class="why"><span>Why</span>
        <input ref={whyField} class="field text" data-testid="tune-why" maxLength={200} value={why} disabled={!mine} placeholder={count > 0 ? "required" : ""} onInput={(e) => props.onWhy(e.currentTarget.value)} /></label>
      <div class="keys">
        <Key testid="tune-apply" primary={ready && why.trim() !== ""} hold={hold} disabled={!ready || why.trim() === ""} onAct={apply}>{applyText(count, hold)}</Key>
        <Key testid="tune-discard" disabled={count === 0} onAct={props.onDiscard}>Discard</Key>
        <span class="gap" />
        <Key testid="tune-undo" disabled={!mine || !props.canUndo} onAct={props.onUndo}>{`Undo set ${props.gainSet}`}</Key>
      </div>
      <p class="foot-note">{mine ? bumpless(props.jump, count) : "Take controls (C) to apply. Staging and prediction work without them."}</p>
    </div>
  );
}
