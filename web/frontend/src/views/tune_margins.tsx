// Margins and response of the loop, live, staged and flown, each with its limit.

import type { JSX } from "preact";
import { Mark } from "../controls";
import type { DesignReport, LoopReport } from "../design";
import type { FlownStep } from "../flown_step";
import { fixed, NONE } from "../format";

interface Row {
  name: string;
  decimals: number;
  of: (loop: LoopReport) => number | null;
  flown?: (step: FlownStep) => number | null;
  limit: (loop: LoopReport) => [">" | "<", number] | null;
}

const scaled = (value: number | null, scale: number): number | null => (value === null ? null : value * scale);

// The limits are the station's (controllers/design.py); rise and overshoot come with each step.
const ROWS: Row[] = [
  { name: "Phase margin, °", decimals: 1, of: (l) => l.phase_margin_deg, limit: () => [">", 30] },
  { name: "Gain margin, dB", decimals: 1, of: (l) => l.gain_margin_db, limit: () => [">", 6] },
  { name: "Delay margin, ms", decimals: 0, of: (l) => scaled(l.delay_margin_s, 1000), limit: () => [">", 40] },
  { name: "Peak sensitivity", decimals: 2, of: (l) => l.peak_sensitivity, limit: () => ["<", 2.3] },
  { name: "Bandwidth, Hz", decimals: 2, of: (l) => scaled(l.bandwidth_rad_s, 1 / (2 * Math.PI)), limit: () => null },
  { name: "Rise 10–90 %, s", decimals: 2, of: (l) => l.step.rise_s, flown: (f) => f.rise_s, limit: (l) => ["<", l.step.rise_limit_s] },
  { name: "Overshoot, %", decimals: 1, of: (l) => l.step.overshoot_percent, flown: (f) => f.overshoot_percent, limit: (l) => ["<", l.step.overshoot_limit_percent] },
  { name: "Settling 2 %, s", decimals: 2, of: (l) => l.step.settling_s, flown: (f) => f.settling_s, limit: () => null },
];

function outside(value: number | null, limit: [">" | "<", number] | null): boolean {
  if (value === null || limit === null) return false;
  return limit[0] === ">" ? value < limit[1] : value > limit[1];
}

function Value({ value, row, loop, tone }: { value: number | null; row: Row; loop: LoopReport; tone: string }): JSX.Element {
  const over = outside(value, row.limit(loop));
  return <td class={over ? "over" : tone}>{over && <Mark level="caution" />}{fixed(value, row.decimals)}</td>;
}

interface Props {
  loop: string;
  live: DesignReport | null;
  staged: DesignReport | null;
  flown: FlownStep | null;
}

export function TuneMargins({ loop, live, staged, flown }: Props): JSX.Element {
  const of = (report: DesignReport | null): LoopReport | undefined => report?.loops.find((l) => l.name === loop);
  const [now, next] = [of(live), of(staged)];
  const lag = live ? `rotor lag ${fixed(live.motor_lag_s * 1000, 0)} ms, delay ${fixed(live.delay_s * 1000, 0)} ms in the model` : "";
  return (
    <section class="panel margins" data-testid="tune-margins">
      <header class="head"><h2>Margins and response</h2><span class="right">{loop === "x" || loop === "y" ? "cut at tilt" : loop === "height" ? "cut at thrust" : "cut at torque"}</span></header>
      <div class="scroll">
        <table class="grid-table">
          <thead><tr><th>Quantity</th><th>Live</th><th>Staged</th><th>Flown</th><th>Limit</th></tr></thead>
          <tbody>
            {now && ROWS.map((row) => {
              const limit = row.limit(now);
              return (
                <tr key={row.name}>
                  <td>{row.name}</td>
                  <Value value={row.of(now)} row={row} loop={now} tone="" />
                  {next ? <Value value={row.of(next)} row={row} loop={next} tone="staged" /> : <td>{NONE}</td>}
                  <td>{flown && row.flown ? fixed(row.flown(flown), row.decimals) : NONE}</td>
                  <td class="unit-cell left">{limit ? `${limit[0] === ">" ? "≥" : "≤"} ${+limit[1].toFixed(2)}` : NONE}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
        <p class="foot-note">{live && !live.stable ? "Live set is unstable: no margins. " : ""}{lag}</p>
      </div>
    </section>
  );
}
