// Choice of trajectory with its fields, units and ranges; the key says what it will fly.

import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { Key, Segments } from "../controls";
import type { Command, TrajectoryKind } from "../protocol";
import { flying, holdsControls, useStore } from "../store";
import { checked, kindLabel, loadTrajectories, shown, VERBS } from "../trajectories";

const FIRST = 3;
const AXES = [{ value: "north", text: "North" }, { value: "east", text: "East" }, { value: "height", text: "Height" }, { value: "yaw", text: "Yaw" }] as const;
type Axis = (typeof AXES)[number]["value"];
type Typed = Record<string, string>;

interface Props {
  give: (command: Command) => void;
  say: (text: string) => void;
}

function textOf(kind: TrajectoryKind, name: string, typed: Typed, axis: string): string {
  const field = kind.fields.find((f) => f.name === name);
  const key = `${kind.kind}.${name}`;
  if (typed[key] !== undefined) return typed[key] as string;
  if (!field || field.default === null) return "";
  return String(+(field.default * shown(field, axis).scale).toFixed(3));
}

export function TrajectoryForm({ give, say }: Props): JSX.Element | null {
  const [kinds, setKinds] = useState<TrajectoryKind[]>([]);
  const [picked, setPicked] = useState("circle");
  const [typed, setTyped] = useState<Typed>({});
  const [axis, setAxis] = useState<Axis>("north");
  const [all, setAll] = useState(false);
  const mine = useStore(holdsControls);
  const offboard = useStore(flying);
  const signedIn = useStore((s) => s.session !== null && s.station === "live");
  useEffect(() => {
    if (signedIn) void loadTrajectories().then(setKinds);
  }, [signedIn]);
  const kind = kinds.find((k) => k.kind === picked) ?? kinds[0];
  if (!kind) return <p class="hint">Trajectories load with the station.</p>;
  const fields = all ? kind.fields : kind.fields.slice(0, FIRST);
  const fly = (): void => {
    const trajectory: Record<string, unknown> = { kind: kind.kind };
    if (kind.kind === "step") trajectory.axis = axis;
    for (const field of kind.fields) {
      const value = checked(field, textOf(kind, field.name, typed, axis), axis);
      if (typeof value === "string") return say(value);
      if (value !== null) trajectory[field.name] = value;
    }
    give({ type: "fly_trajectory", trajectory });
  };
  return (
    <div class="trajectory">
      <Segments testid="trajectory" label="Trajectory" value={kind.kind} options={kinds.map((k) => ({ value: k.kind, text: kindLabel(k.kind) }))} onPick={setPicked} />
      {kind.kind === "step" && <Segments testid="step-axis" label="Axis" options={AXES} value={axis} onPick={setAxis} />}
      <div class="fields">
        <span class="go">
          {kind.fields.length > FIRST && <button type="button" class="text-key" data-testid="all-fields" onClick={() => setAll(!all)}>{all ? "Fewer fields" : `All ${kind.fields.length} fields`}</button>}
          <Key testid="fly-trajectory" disabled={!mine || !offboard} title={offboard ? undefined : "Start offboard first"} onAct={fly}>{VERBS[kind.kind] ?? "Fly"}</Key>
        </span>
        {fields.map((field) => {
          const { unit } = shown(field, axis);
          const text = textOf(kind, field.name, typed, axis);
          const bad = typeof checked(field, text, axis) === "string";
          return (
            <label key={field.name} class="labelled">
              <span class="label">{field.label[0]?.toUpperCase() + field.label.slice(1)}<span class="unit">{unit}</span></span>
              <input class="field" data-testid={`trajectory-${field.name}`} inputMode="decimal" value={text} aria-invalid={bad} placeholder={field.default === null ? "keep" : ""}
                onInput={(e) => setTyped({ ...typed, [`${kind.kind}.${field.name}`]: e.currentTarget.value })} />
            </label>
          );
        })}
      </div>
    </div>
  );
}
