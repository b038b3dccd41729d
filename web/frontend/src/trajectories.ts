// What an operator may set of a trajectory. Angles are typed in degrees and sent in radians.

import { request, StationError } from "./api";
import { RAD_TO_DEG } from "./format";
import type { TrajectoryField, TrajectoryKind } from "./protocol";
import { say } from "./store";

let kinds: Promise<TrajectoryKind[]> | null = null;

export function loadTrajectories(): Promise<TrajectoryKind[]> {
  kinds ??= request<TrajectoryKind[]>("/api/trajectories").catch((error: unknown) => {
    kinds = null;
    if (!(error instanceof StationError)) throw error;
    say("caution", error.message);
    return [];
  });
  return kinds;
}

const LABELS: Record<string, string> = { hover: "Hover", go_to: "Go to", circle: "Circle", figure_eight: "Eight", step: "Step" };
export const VERBS: Record<string, string> = {
  hover: "Fly hover", go_to: "Fly there", circle: "Fly circle", figure_eight: "Fly eight", step: "Fly step",
};

export function kindLabel(kind: string): string {
  return LABELS[kind] ?? kind;
}

export interface Shown {
  unit: string;
  scale: number;
}

// How a field is shown: radians as degrees; the size of a step depends on its axis.
export function shown(field: TrajectoryField, axis: string): Shown {
  if (field.unit === "rad" || (field.unit === "m or rad" && axis === "yaw")) return { unit: "°", scale: RAD_TO_DEG };
  if (field.unit === "m or rad") return { unit: "m", scale: 1 };
  return { unit: field.unit.replace("^2", "²"), scale: 1 };
}

export function checked(field: TrajectoryField, text: string, axis: string): number | string | null {
  const { unit, scale } = shown(field, axis);
  if (text.trim() === "") return field.default === null ? null : `${field.label}: a number is needed`;
  const typed = Number(text.replace("−", "-").replace(",", "."));
  const value = typed / scale;
  if (!Number.isFinite(value)) return `${field.label}: '${text}' is not a number`;
  if (value < field.minimum - 1e-9 || value > field.maximum + 1e-9) {
    return `${field.label} ${typed} ${unit} is outside ${+(field.minimum * scale).toFixed(2)} to ${+(field.maximum * scale).toFixed(2)} ${unit}`;
  }
  return value;
}
