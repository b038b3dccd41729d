// Predicted steps, live and staged, with the step that was flown; and the command that makes them.

import type { JSX } from "preact";
import { useMemo } from "preact/hooks";
import { type Curve, PlainChart } from "../charts/plain_chart";
import type { LoopReport } from "../design";
import type { FlownStep } from "../flown_step";
import { display, LOOP_NAMES } from "../tune_groups";

interface Props {
  loop: string;
  live: LoopReport | undefined;
  staged: LoopReport | null;
  flown: FlownStep | null;
}

const BEFORE_S = 0.2;

function shownUntil(loop: string): number {
  return ["roll", "pitch", "yaw"].includes(loop) ? 2 : 8;
}

// A curve that rests at zero before the step.
function curve(label: string, token: string, x: number[], y: number[], scale: number): Curve {
  return { label, token, x: [-BEFORE_S, ...x], y: [0, ...y.map((v) => v * scale)] };
}

function stepCurves({ live, staged, flown }: Props): Curve[] {
  if (!live) return [];
  const { scale } = display(live.step.unit);
  const size = live.step.size * scale;
  const end = live.step.time_s[live.step.time_s.length - 1] ?? 1;
  const curves: Curve[] = [{ label: "ref.", token: "reference", dash: true, x: [-BEFORE_S, 0, 1e-6, end], y: [0, 0, size, size] }];
  if (flown) curves.push(curve("flown", "trace1", flown.time_s, flown.value, scale));
  curves.push(curve("model live", "text", live.step.time_s, live.step.value, scale));
  if (staged) curves.push(curve("model staged", "accent", staged.step.time_s, staged.step.value, scale));
  return curves;
}

function commandCurves({ live, staged }: Props): Curve[] {
  if (!live) return [];
  const { scale } = display(live.step.command_unit);
  const curves = [curve("model live", "text", live.step.time_s, live.step.command, scale)];
  if (staged) curves.push(curve("model staged", "accent", staged.step.time_s, staged.step.command, scale));
  return curves;
}

const COMMAND_NAMES: Record<string, string> = { "N m": "Torque", N: "Thrust change", rad: "Tilt command" };
const STEP_SPANS: Record<string, number[]> = { rad: [8, 12, 16, 32, 64, 360], m: [0.8, 1.2, 1.6, 4, 20] };
const COMMAND_STEPS: Record<string, number[]> = { "N m": [50, 100, 200, 400, 800, 1600, 4000, 20000], N: [1, 2, 4, 8, 20, 80], rad: [4, 8, 16, 32, 64, 360] };

export function TuneSteps(props: Props): JSX.Element {
  const { loop, live, staged, flown } = props;
  const steps = useMemo(() => stepCurves(props), [live, staged, flown]);
  const commands = useMemo(() => commandCurves(props), [live, staged]);
  const step = live?.step;
  const unit = display(step?.unit ?? "rad");
  const command = display(step?.command_unit ?? "N m");
  const size = (step?.size ?? NaN) * unit.scale;
  const name = LOOP_NAMES[loop] ?? loop[0]?.toUpperCase() + loop.slice(1);
  const span: [number, number] = [-BEFORE_S, shownUntil(loop)];
  const commandName = COMMAND_NAMES[step?.command_unit ?? "N m"] ?? "Command";
  return (
    <>
      <PlainChart key={`step-${loop}`} testid="tune-step" title={`${name} step`} sub={step ? `${size.toFixed(2)} ${unit.unit}` : ""} yLabel={`${name.toLowerCase()}, ${unit.unit}`} decimals={unit.decimals}
        curves={steps} x={span} sync="tune" range={{ kind: "span", low: 0, steps: STEP_SPANS[step?.unit ?? "rad"] ?? [1, 2, 4] }} />
      <PlainChart key={`command-${loop}`} testid="tune-command" title={commandName} sub="from the model" yLabel={`${commandName.split(" ")[0]?.toLowerCase()}, ${command.unit}`} decimals={command.decimals}
        curves={commands} x={span} sync="tune" range={{ kind: "about", steps: COMMAND_STEPS[step?.command_unit ?? "N m"] ?? [1, 10, 100] }} />
    </>
  );
}
