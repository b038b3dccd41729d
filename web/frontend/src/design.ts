// Predictions of the station for staged gains: asked while typing, newest answer wins.

import { useEffect, useRef, useState } from "preact/hooks";
import { post, request, StationError } from "./api";
import type { ControllerKind, GainRow } from "./protocol";

export interface Pole {
  real: number;
  imag: number;
  damping: number;
  natural_rad_s: number;
  state: string;
}

export interface StepPrediction {
  size: number;
  unit: string;
  command_unit: string;
  time_s: number[];
  value: number[];
  command: number[];
  overshoot_percent: number | null;
  rise_s: number | null;
  settling_s: number | null;
  overshoot_limit_percent: number;
  rise_limit_s: number;
}

export interface LoopReport {
  name: string;
  phase_margin_deg: number | null;
  gain_margin_db: number | null;
  delay_margin_s: number | null;
  peak_sensitivity: number | null;
  bandwidth_rad_s: number | null;
  step: StepPrediction;
}

export interface DesignWarning {
  loop: string;
  quantity: string;
  text: string;
}

export interface DesignReport {
  stable: boolean;
  inner_stable: boolean;
  motor_lag_s: number;
  delay_s: number;
  gains: Record<string, number[][]>;
  poles: Pole[];
  loops: LoopReport[];
  warnings: DesignWarning[];
}

export interface Prediction {
  controller: ControllerKind;
  base: string;
  live: DesignReport;
  staged: DesignReport;
  jump: { torque_n_m: number; thrust_n: number } | null;
}

export interface GainTables {
  controllers: Record<ControllerKind, { table: GainRow[]; newest: { name: string; values: Record<string, number> } }>;
}

export type Changes = Record<string, number>;

const DEBOUNCE_MS = 20;

export interface DesignState {
  prediction: Prediction | null;
  // The prediction answers exactly what is staged now.
  fresh: boolean;
  problem: string;
  tookMs: number;
}

export function askDesign(controller: ControllerKind, changes: Changes, signal?: AbortSignal): Promise<Prediction> {
  return post<Prediction>("/api/design", { controller, changes }, signal);
}

export function loadGains(): Promise<GainTables> {
  return request<GainTables>("/api/gains");
}

// Live and staged prediction for the changes; asks again when the live set changes.
export function useDesign(controller: ControllerKind | null, changes: Changes, gainSet: number): DesignState {
  const [result, setResult] = useState<Omit<DesignState, "fresh"> & { key: string }>({ prediction: null, problem: "", tookMs: 0, key: "" });
  const running = useRef<AbortController | null>(null);
  const key = JSON.stringify([controller, changes, gainSet]);
  useEffect(() => {
    if (!controller) return undefined;
    const abort = new AbortController();
    running.current?.abort();
    running.current = abort;
    const timer = setTimeout(() => {
      const began = performance.now();
      askDesign(controller, changes, abort.signal)
        .then((prediction) => setResult({ prediction, problem: "", tookMs: performance.now() - began, key }))
        .catch((error: unknown) => {
          if (error instanceof StationError) setResult((old) => ({ ...old, problem: error.message, key }));
          else if (!(error instanceof DOMException && error.name === "AbortError")) throw error;
        });
    }, DEBOUNCE_MS);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }, [key]);
  return { ...result, fresh: result.key === key };
}
