// The 3-D scene in its own frame, with camera presets and what its colours mean.

import type { JSX } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { post, StationError } from "../api";
import { Segments } from "../controls";
import { fixed } from "../format";
import { say, useStore } from "../store";

const CAMERAS = [
  { value: "free", text: "Free" }, { value: "chase", text: "Chase" }, { value: "top", text: "Top" }, { value: "north", text: "North" },
] as const;
type Camera = (typeof CAMERAS)[number]["value"];

function Origin(): JSX.Element {
  const latitude = useStore((s) => s.status?.origin_latitude_deg ?? null);
  const longitude = useStore((s) => s.status?.origin_longitude_deg ?? null);
  if (latitude === null || longitude === null) return <span class="sub">local NED</span>;
  const [ns, ew] = [latitude < 0 ? "S" : "N", longitude < 0 ? "W" : "E"];
  return <span class="sub">local NED, origin {fixed(Math.abs(latitude), 5)}° {ns} {fixed(Math.abs(longitude), 5)}° {ew}</span>;
}

export function ScenePanel(): JSX.Element {
  const [camera, setCamera] = useState<Camera | null>("free");
  const lost = useStore((s) => s.status?.link_state === "lost" || s.station === "lost");
  const following = useRef(true);
  const tell = (view: Camera | "own"): void => {
    following.current = view !== "own";
    post("/api/scene/camera", { view }).catch((error: unknown) => {
      if (!(error instanceof StationError)) throw error;
      say("caution", error.message);
    });
  };
  const look = (view: Camera): void => {
    setCamera(view);
    tell(view);
  };
  // A user who turns or zooms the picture has it: no preset is on, and the camera follows nothing until one is pressed.
  useEffect(() => {
    const taken = (event: MessageEvent<{ type?: string }>): void => {
      if (event.origin !== location.origin || event.data?.type !== "scene-taken" || !following.current) return;
      setCamera(null);
      tell("own");
    };
    window.addEventListener("message", taken);
    return () => window.removeEventListener("message", taken);
  }, []);
  return (
    <section class="panel scene" aria-label="Scene">
      <header class="head">
        <h2>Scene</h2>
        <Origin />
        <span class="right">
          <span class="legend">
            <span class="entry"><i class="swatch dash c-reference" />reference</span>
            <span class="entry"><i class="swatch c-trace1" />flown, last 30 s</span>
            <span class="entry"><svg class="ellipse" viewBox="0 0 16 10" width="14" height="9" aria-hidden="true"><ellipse cx="8" cy="5" rx="7" ry="4" fill="none" stroke="currentColor" /></svg>position 3σ</span>
          </span>
          <Segments testid="scene-camera" label="Camera" options={CAMERAS} value={camera} onPick={look} />
        </span>
      </header>
      <iframe src="/scene/" title="3-D scene" data-testid="scene-frame" class={lost ? "stale" : ""} />
    </section>
  );
}
