// What the server says and hears. Mirrors gcs/commands.py, gcs/records.py, gcs/signals.py.

export type Level = "advisory" | "caution" | "warning";
export type ControllerKind = "lqr" | "pid";

export interface SignalRow {
  name: string;
  unit: string;
  labels: string[];
  offset: number;
  size: number;
  description: string;
}

export interface Session {
  name: string;
  role: "observer" | "operator";
  csrf: string;
  client?: string;
}

export interface StationEvent {
  // Vehicle time; null for what happened outside of the flight process.
  t_s: number | null;
  level: Level;
  text: string;
  source: string;
  who: string;
}

export interface GainRecord {
  number: number;
  utc_s: number;
  who: string;
  why: string;
  controller: ControllerKind;
  name: string;
  gains: Record<string, number>;
  changes: Record<string, [number, number]>;
  verdict: string;
}

export interface TrajectoryStatus {
  description: string;
  lap: number | null;
  progress: number | null;
  left_s: number | null;
}

export interface Status {
  t_s: number;
  utc_s: number;
  vehicle_name: string;
  vehicle_type: string;
  autopilot: string;
  system_id: number;
  authority: string;
  link_url: string;
  link_state: "none" | "live" | "silent" | "lost";
  link_silence_s: number;
  signing: string;
  state: string;
  vehicle_mode: string;
  armed: boolean;
  landed: string;
  failsafe: string;
  estimator: string;
  position_source: string;
  controller: ControllerKind;
  gain_set: number;
  gain_history: GainRecord[];
  last_good: number;
  controls_holder: string;
  controls_client: string;
  battery_v: number | null;
  battery_remaining: number | null;
  flight_time_s: number;
  trajectory: TrajectoryStatus;
  origin_latitude_deg: number | null;
  origin_longitude_deg: number | null;
  ticks: number;
  dropped_frames: number;
  tick_p99_us: number;
  // Added by the hub: name of the run being recorded (it begins with its UTC start), and how that goes.
  recording?: string;
  recording_state?: "off" | "waiting" | "recording" | "stopped";
  recording_bytes?: number;
  recording_reason?: string;
}

export interface Hello {
  type: "hello";
  signals: SignalRow[];
  frame_size: number;
  status: Status | null;
  events: StationEvent[];
  backlog_seconds: number;
  watchers: string[];
}

export interface TrajectoryField {
  name: string;
  label: string;
  unit: string;
  minimum: number;
  maximum: number;
  default: number | null;
}

export interface TrajectoryKind {
  kind: string;
  label: string;
  fields: TrajectoryField[];
}

export interface GainRow {
  key: string;
  label: string;
  symbol: string;
  unit: string;
  minimum: number;
  maximum: number;
  group: string;
}

export type Command = { type: string } & Record<string, unknown>;

export interface Answer {
  accepted: boolean;
  reason: string;
}
