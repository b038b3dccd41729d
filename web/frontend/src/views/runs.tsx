// Runs: what has been recorded.

import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { request, StationError } from "../api";
import { megabytes, minutes, NONE } from "../format";

interface Run {
  name: string;
  bytes: number;
  summary: { vehicle?: string; started_utc?: string; ended_utc?: string; ticks?: number; missing_ticks?: number; gain_history?: unknown[]; stopped_because?: string };
}

function length({ summary }: Run): string {
  if (!summary.started_utc) return NONE;
  if (!summary.ended_utc) return "recording";
  return minutes((Date.parse(summary.ended_utc) - Date.parse(summary.started_utc)) / 1000);
}

export function RunsView(): JSX.Element {
  const [runs, setRuns] = useState<Run[] | null>(null);
  const [problem, setProblem] = useState("");
  useEffect(() => {
    request<Run[]>("/api/runs").then(setRuns).catch((error: unknown) => {
      if (!(error instanceof StationError)) throw error;
      setProblem(error.message);
    });
  }, []);
  return (
    <section class="panel whole" data-testid="runs">
      <header class="head"><h2>Runs</h2><span class="sub">newest first</span></header>
      {problem && <p class="refusal">{problem}</p>}
      {runs?.length === 0 && <p class="empty"><b>No run recorded yet.</b>Each flight is recorded from the first packet. Start the station with a vehicle and its folder appears here.</p>}
      {runs && runs.length > 0 && (
        <div class="scroll"><table class="grid-table runs-table">
          <thead><tr><th>Run</th><th class="left">Vehicle</th><th>Length</th><th>Ticks</th><th>Missing</th><th>Gain sets</th><th>Size</th></tr></thead>
          <tbody>{runs.map((run) => (
            <tr key={run.name}>
              <td>{run.name}</td><td class="left">{run.summary.vehicle ?? NONE}</td><td>{length(run)}</td><td>{run.summary.ticks ?? NONE}</td>
              <td>{run.summary.missing_ticks ?? NONE}</td><td>{run.summary.gain_history?.length ?? NONE}</td><td>{megabytes(run.bytes)}</td>
            </tr>))}</tbody>
        </table></div>
      )}
      <p class="empty">Open a run in any ground station (flight.tlog) or in Foxglove (signals.mcap). Replay in this view comes later.</p>
    </section>
  );
}
