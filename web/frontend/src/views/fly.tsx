// Fly: attitude, scene, state, charts, manoeuvre, alerts.

import type { JSX } from "preact";
import { useEffect, useState } from "preact/hooks";
import { openCount } from "../alerts";
import { Chart } from "../charts/live_chart";
import { useClock } from "../frame_loop";
import { state } from "../store";
import { AlertsBody, AlertsPanel } from "./alerts_panel";
import { FLY_CHARTS } from "./fly_charts";
import { HorizonPanel } from "./horizon_panel";
import { ControllerSwitch, ManoeuvreBody } from "./manoeuvre";
import { ScenePanel } from "./scene_panel";
import { StateTable } from "./state_table";
import { ToolRow } from "./tool_row";

export type Size = "large" | "middle" | "small";

function sizeNow(): Size {
  return innerWidth >= 1600 ? "large" : innerWidth > 1100 ? "middle" : "small";
}

export function useSize(): Size {
  const [size, setSize] = useState<Size>(sizeNow);
  useEffect(() => {
    const resized = (): void => setSize(sizeNow());
    window.addEventListener("resize", resized);
    return () => window.removeEventListener("resize", resized);
  }, []);
  return size;
}

type Tab = "state" | "manoeuvre" | "alerts";
const TAB_NAMES: Record<Tab, string> = { state: "State", manoeuvre: "Manoeuvre", alerts: "Alerts" };

function OpenCount(): JSX.Element | null {
  const now = useClock(1000);
  const open = openCount(state, now);
  return open > 0 ? <span class="count"> {open}</span> : null;
}

function Tabbed({ tabs }: { tabs: Tab[] }): JSX.Element {
  const [tab, setTab] = useState<Tab>("manoeuvre");
  const [refused, setRefused] = useState("");
  return (
    <section class="panel tabbed">
      <div class="tabs" role="tablist">
        {tabs.map((name) => (
          <button type="button" role="tab" key={name} data-testid={`fly-tab-${name}`} aria-selected={tab === name} onClick={() => setTab(name)}>
            {TAB_NAMES[name]}{name === "alerts" && <OpenCount />}
          </button>
        ))}
        <span class="tab-tool"><ControllerSwitch onRefused={setRefused} /></span>
      </div>
      {refused && <p class="refusal">{refused}</p>}
      {tab === "state" && <StateTable />}
      {tab === "manoeuvre" && <ManoeuvreBody />}
      {tab === "alerts" && <AlertsBody />}
    </section>
  );
}

function ManoeuvrePanel(): JSX.Element {
  const [refused, setRefused] = useState("");
  return (
    <section class="panel manoeuvre">
      <header class="head"><h2>Manoeuvre</h2><span class="right">Controller <ControllerSwitch onRefused={setRefused} /></span></header>
      {refused && <p class="refusal">{refused}</p>}
      <ManoeuvreBody />
    </section>
  );
}

export function FlyView({ hidden }: { hidden: boolean }): JSX.Element {
  const size = useSize();
  const charts = size === "small" ? FLY_CHARTS.filter((c) => !["rates", "actuators"].includes(c.id)) : FLY_CHARTS;
  return (
    <div class={`fly ${size}`} hidden={hidden}>
      <ScenePanel />
      <ToolRow />
      <div class="charts">{charts.map((spec) => <Chart key={spec.id} spec={spec} />)}</div>
      <div class="side">
        <HorizonPanel />
        {size !== "small" && <StateTable />}
        {size === "large" && <><ManoeuvrePanel /><AlertsPanel /></>}
        {size === "middle" && <Tabbed tabs={["manoeuvre", "alerts"]} />}
        {size === "small" && <Tabbed tabs={["state", "manoeuvre", "alerts"]} />}
      </div>
    </div>
  );
}
