import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { fixed, heading, RAD_TO_DEG } from "../format";
import { onFrame, useClock } from "../frame_loop";
import { isStale, ring, sampleAgeS } from "../ring";
import { drawHorizon, type HorizonState } from "./horizon";

function readState(nowMs: number): HorizonState {
  const v = (name: string, k = 0): number => ring.value(name, k);
  return {
    rollRad: v("estimate.euler", 0), pitchRad: v("estimate.euler", 1), yawRad: v("estimate.euler", 2),
    speed: Math.hypot(v("estimate.velocity_ned", 0), v("estimate.velocity_ned", 1)),
    height: -v("estimate.position_ned", 2),
    rollSetRad: v("control.euler_command", 0), pitchSetRad: v("control.euler_command", 1), yawSetRad: v("reference.yaw"),
    speedSet: Math.hypot(v("reference.velocity_ned", 0), v("reference.velocity_ned", 1)),
    heightSet: -v("reference.position_ned", 2),
    stale: isStale(nowMs),
  };
}

// The same in words, for a screen reader and for whoever cannot see the canvas.
function Words(): JSX.Element {
  const now = useClock(1000);
  const s = readState(now);
  const age = s.stale && ring.count > 0 ? `, ${sampleAgeS(now).toFixed(1)} s old` : "";
  const text =
    `Roll ${fixed(s.rollRad * RAD_TO_DEG, 1)} °, pitch ${fixed(s.pitchRad * RAD_TO_DEG, 1)} °, heading ${heading(s.yawRad)}, ` +
    `speed ${fixed(s.speed, 2)} m/s, height ${fixed(s.height, 2)} m${age}`;
  return <p class="unseen" data-testid="horizon-words">{text}</p>;
}

export function HorizonPanel(): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => onFrame(50, (now) => canvas.current && drawHorizon(canvas.current, readState(now))), []);
  return (
    <section class="panel horizon" aria-label="Attitude, speed, height, heading" data-testid="horizon">
      <canvas ref={canvas} aria-hidden="true" />
      <Words />
    </section>
  );
}
