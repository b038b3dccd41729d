// Flight check: fly a step on the live set and compare it with the model.

import type { JSX } from "preact";
import { useState } from "preact/hooks";
import { send } from "../api";
import { Key } from "../controls";
import type { StepPrediction } from "../design";
import { canFly, type FlownStep, rmsFromModel } from "../flown_step";
import { fixed } from "../format";
import { flying, holdsControls, useStore } from "../store";
import { display, LOOP_NAMES } from "../tune_groups";

const AXES: Record<string, string> = { x: "north", y: "east", height: "height", yaw: "yaw" };

export function TuneCheck({ loop, step, flown }: { loop: string; step: StepPrediction | undefined; flown: FlownStep | null }): JSX.Element | null {
  const mine = useStore(holdsControls);
  const offboard = useStore(flying);
  const [refused, setRefused] = useState("");
  if (!canFly(loop) || !step) return null;
  const { unit, scale, decimals } = display(step.unit);
  const name = LOOP_NAMES[loop] ?? loop;
  const fly = (): void => {
    void send({ type: "fly_trajectory", trajectory: { kind: "step", axis: AXES[loop], size: step.size } })
      .then((answer) => setRefused(answer.accepted ? "" : answer.reason));
  };
  const rms = flown ? rmsFromModel(flown, step.time_s, step.value) * scale : NaN;
  return (
    <section class="check">
      <header class="head"><h2>Flight check</h2><span class="sub">{name.toLowerCase()} step {fixed(step.size * scale, decimals === 2 ? 2 : 1)} {unit}</span>
        <span class="right"><Key testid="fly-step" disabled={!mine || !offboard} title={offboard ? undefined : "Start offboard first"} onAct={fly}>Fly step</Key></span></header>
      <p class="foot-note" data-testid="flight-check">
        {refused || (flown ? `Last flown ${fixed(flown.size * scale, 2)} ${unit}: ${fixed(rms, decimals)} ${unit} RMS from the live model.` : "Not flown in the last minutes. In offboard and at rest, Fly step compares flight and model.")}
      </p>
    </section>
  );
}
