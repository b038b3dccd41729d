// REST calls. Every answer that is not what was asked for becomes a StationError with words for the operator.

import type { Answer, Command, Session } from "./protocol";
import { say, state, update } from "./store";

export class StationError extends Error {}

interface Problem {
  detail?: unknown;
  reason?: unknown;
}

async function words(response: Response): Promise<string> {
  const text = await response.text();
  try {
    const body = JSON.parse(text) as Problem;
    for (const part of [body.reason, body.detail]) if (typeof part === "string") return part;
    if (Array.isArray(body.detail)) return body.detail.map((d: { msg?: string }) => d.msg ?? "").join("; ");
  } catch (error) {
    if (!(error instanceof SyntaxError)) throw error;
  }
  return text.slice(0, 160) || `The station answered ${response.status}.`;
}

export async function request<T>(path: string, init?: RequestInit): Promise<T> {
  let response: Response;
  try {
    response = await fetch(path, { ...init, credentials: "same-origin" });
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new StationError("No connection to the station. Nothing you press is sent.");
  }
  if (response.status === 401) {
    location.assign("/login");
    throw new StationError("The session has ended. Log in again.");
  }
  if (!response.ok) throw new StationError(await words(response));
  return (await response.json()) as T;
}

export function post<T>(path: string, body: unknown, signal?: AbortSignal): Promise<T> {
  const headers = { "Content-Type": "application/json", "X-CSRF-Token": state.session?.csrf ?? "" };
  return request<T>(path, { method: "POST", headers, body: JSON.stringify(body), ...(signal ? { signal } : {}) });
}

export async function openSession(): Promise<void> {
  update({ session: await request<Session>("/api/session") });
}

// Sends one command. A refusal is said in the bar; the answer also goes to the caller, for the spot where it was pressed.
export async function send(command: Command): Promise<Answer> {
  if (state.station === "lost") return refuse("No connection to the station. Nothing you press is sent.");
  try {
    const answer = await post<Answer>("/api/commands", command);
    return answer.accepted ? answer : refuse(answer.reason);
  } catch (error) {
    if (error instanceof StationError) return refuse(error.message);
    throw error;
  }
}

function refuse(reason: string): Answer {
  say("caution", reason);
  return { accepted: false, reason };
}
