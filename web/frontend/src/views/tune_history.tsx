// Gain history, newest first: set, when, who, why, what changed, phase margin, verdict.

import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { StationError } from "../api";
import { askDesign } from "../design";
import { clock, figures, fixed, NONE } from "../format";
import type { ControllerKind, GainRecord } from "../protocol";
import { controllerName } from "../strip";
import { useStore } from "../store";

const MARGIN_ROWS = 8;
const margins = new Map<string, number | null>();

function key(record: GainRecord, loop: string): string {
  return `${record.utc_s} ${record.number} ${loop}`;
}

// Phase margins of the sets of one controller, asked one after the other and kept.
function useMargins(records: GainRecord[], kind: ControllerKind | null, loop: string): void {
  const [, setCount] = useState(0);
  const wanted = records.filter((r) => r.controller === kind).slice(0, MARGIN_ROWS);
  const missing = wanted.filter((r) => !margins.has(key(r, loop)));
  useEffect(() => {
    if (!kind || missing.length === 0) return undefined;
    const abort = new AbortController();
    const work = async (): Promise<void> => {
      for (const record of missing) {
        const { staged } = await askDesign(kind, record.gains, abort.signal);
        for (const report of staged.loops) margins.set(key(record, report.name), report.phase_margin_deg);
        setCount((n) => n + 1);
      }
    };
    work().catch((error: unknown) => {
      const stopped = error instanceof DOMException && error.name === "AbortError";
      if (!stopped && !(error instanceof StationError)) throw error;
    });
    return () => abort.abort();
  }, [missing.map((r) => key(r, loop)).join("|")]);
}

function changeText(record: GainRecord): string {
  const changed = Object.entries(record.changes);
  const [first] = changed;
  if (!first) return controllerName(record.controller);
  const [name, [from, to]] = first;
  return `${name.split(".").pop()?.replaceAll("_", " ")} ${figures(from)} → ${figures(to)}${changed.length > 1 ? ` and ${changed.length - 1} more` : ""}`;
}

function when(utcS: number): string {
  const today = Math.floor(utcS / 86400) === Math.floor(Date.now() / 86400000);
  return today ? clock(utcS) : new Date(utcS * 1000).toISOString().slice(5, 10);
}

export function TuneHistory({ loop }: { loop: string }): JSX.Element {
  const history = useStore((s) => s.status?.gain_history);
  const live = useStore((s) => s.status?.gain_set ?? -1);
  const kind = useStore((s) => s.status?.controller ?? null);
  const records = [...(history ?? [])].reverse();
  useMargins(records, kind, loop);
  return (
    <section class="panel history" data-testid="tune-history">
      <header class="head"><h2>History</h2><span class="sub">newest first</span></header>
      {records.length === 0 && <p class="empty"><b>No gain set yet.</b>The set the flight process starts with, and each change with who and why, appears here.</p>}
      {records.length > 0 && (
        <div class="scroll" tabIndex={0}>
          <table class="grid-table">
            <thead><tr><th>Set</th><th class="left">UTC</th><th class="left">Who</th><th class="left">Why</th><th class="left">Change</th><th>Phase margin</th><th class="left">Verdict</th></tr></thead>
            <tbody>
              {records.map((record) => {
                const margin = record.controller === kind ? margins.get(key(record, loop)) : undefined;
                return (
                  <tr key={key(record, "")} class={record.number === live ? "current" : ""} data-testid={`history-${record.number}`}>
                    <td>{record.number}{record.number === live && " live"}</td>
                    <td class="left">{when(record.utc_s)}</td>
                    <td class="left">{record.who}</td>
                    <td class="left why" title={record.why}>{record.why || record.name}</td>
                    <td class="left">{changeText(record)}</td>
                    <td class="strong">{margin === undefined || margin === null ? NONE : `${fixed(margin, 1)}°`}</td>
                    <td class="left">{record.verdict || "not judged"}</td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}
