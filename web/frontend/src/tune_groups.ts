// What belongs to each tab of the Tune view: loops, poles, rows of the gain matrices, units for people.

import { RAD_TO_DEG } from "./format";

export type Group = "roll" | "pitch" | "yaw" | "height" | "position";
export const GROUPS: Group[] = ["roll", "pitch", "yaw", "height", "position"];

export function title(group: Group): string {
  return group[0]?.toUpperCase() + group.slice(1);
}

export const LOOPS: Record<Group, string[]> = { roll: ["roll"], pitch: ["pitch"], yaw: ["yaw"], height: ["height"], position: ["x", "y"] };
export const LOOP_NAMES: Record<string, string> = { x: "North", y: "East" };

const POLE_STATES: Record<Group, string[]> = {
  roll: ["roll", "p", "torque_roll"], pitch: ["pitch", "q", "torque_pitch"], yaw: ["yaw", "r", "torque_yaw"],
  height: ["down", "v_down", "height", "thrust"], position: ["north", "east", "v_north", "v_east", "x", "y"],
};

export function poleBelongs(state: string, group: Group): boolean {
  return state.split(" ").some((word) => POLE_STATES[group].includes(word));
}

export interface MatrixGain {
  label: string;
  symbol: string;
  table: string;
  row: number;
  column: number;
  unit: string;
}

function attitude(k: number, letter: string, rate: string, velocity: [number, string, string] | null): MatrixGain[] {
  const rows: MatrixGain[] = [
    { label: "Angle", symbol: `k_${letter}`, table: "attitude K", row: k, column: k, unit: "N m/rad" },
    { label: "Rate", symbol: `k_${rate}`, table: "attitude K", row: k, column: 3 + k, unit: "N m s/rad" },
    { label: "Integral", symbol: "k_i", table: "attitude Ki", row: k, column: k, unit: "N m/(rad s)" },
  ];
  if (velocity) rows.push({ label: velocity[2], symbol: `k_${velocity[1]}`, table: "attitude K", row: k, column: velocity[0], unit: "N s" });
  return rows;
}

// Row -1: the row with the largest entry of that column (north acts through pitch, east through roll).
export const MATRIX_GAINS: Record<Group, MatrixGain[]> = {
  roll: attitude(0, "φ", "p", [7, "v", "Side speed"]),
  pitch: attitude(1, "θ", "q", [6, "u", "Forward speed"]),
  yaw: attitude(2, "ψ", "r", null),
  height: [
    { label: "Height", symbol: "k_z", table: "height K", row: 0, column: 0, unit: "N/m" },
    { label: "Climb", symbol: "k_vz", table: "height K", row: 0, column: 1, unit: "N s/m" },
    { label: "Integral", symbol: "k_i", table: "height Ki", row: 0, column: 0, unit: "N/(m s)" },
  ],
  position: [
    { label: "Position", symbol: "k_x", table: "position K", row: -1, column: 0, unit: "rad/m" },
    { label: "Speed", symbol: "k_vx", table: "position K", row: -1, column: 2, unit: "rad s/m" },
    { label: "Integral", symbol: "k_i", table: "position Ki", row: -1, column: 0, unit: "rad/(m s)" },
  ],
};

export function matrixValue(gains: Record<string, number[][]>, gain: MatrixGain): number {
  const table = gains[gain.table];
  if (!table) return NaN;
  if (gain.row >= 0) return Math.abs(table[gain.row]?.[gain.column] ?? NaN);
  return Math.max(...table.map((row) => Math.abs(row[gain.column] ?? NaN)));
}

export interface Display {
  unit: string;
  scale: number;
  decimals: number;
}

// Units of steps and commands as people read them.
export function display(unit: string): Display {
  switch (unit) {
    case "rad": return { unit: "°", scale: RAD_TO_DEG, decimals: 2 };
    case "N m": return { unit: "mN m", scale: 1000, decimals: 1 };
    case "N": return { unit: "N", scale: 1, decimals: 2 };
    default: return { unit, scale: 1, decimals: 3 };
  }
}
