// Numbers as an instrument writes them: fixed decimals, U+2212 for minus, a dash when there is no value.

export const RAD_TO_DEG = 180 / Math.PI;
export const NONE = "–";

export function fixed(value: number | null | undefined, decimals: number): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = Math.abs(value).toFixed(decimals);
  const negative = value < 0 && Number(text) !== 0;
  return negative ? `−${text}` : text;
}

export function signed(value: number | null | undefined, decimals: number): string {
  const text = fixed(value, decimals);
  if (text === NONE || text.startsWith("−")) return text;
  return Number(text) === 0 ? text : `+${text}`;
}

// Significant figures for gains and weights, whose sizes differ by decades.
export function figures(value: number | null | undefined, count = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  if (value === 0) return "0";
  const digits = Math.max(0, Math.min(6, count - 1 - Math.floor(Math.log10(Math.abs(value)))));
  return fixed(value, digits);
}

export function clock(utcS: number, tenths = false): string {
  if (!Number.isFinite(utcS)) return NONE;
  const text = new Date(utcS * 1000).toISOString();
  return tenths ? text.slice(11, 21) : text.slice(11, 19);
}

export function minutes(seconds: number): string {
  if (!Number.isFinite(seconds)) return NONE;
  const whole = Math.max(0, Math.floor(seconds));
  return `${String(Math.floor(whole / 60)).padStart(2, "0")}:${String(whole % 60).padStart(2, "0")}`;
}

// "2.49", or a dash; units are written by the caller in their own column or span.
export function heading(radians: number): string {
  if (!Number.isFinite(radians)) return NONE;
  const degrees = Math.round((radians * RAD_TO_DEG + 360) % 360) % 360;
  return `${String(degrees).padStart(3, "0")}°`;
}

const UNIT_WORDS: [RegExp, string][] = [
  [/\^2/g, "²"],
  [/\^3/g, "³"],
  [/^1$/g, ""],
  [/^deg$/g, "°"],
];

export function unitText(unit: string): string {
  return UNIT_WORDS.reduce((text, [pattern, word]) => text.replace(pattern, word), unit);
}

export function megabytes(bytes: number): string {
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(0)} MB`;
}
