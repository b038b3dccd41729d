import type { JSX } from "preact";
export function TuneView(): JSX.Element { return <section class="panel whole" />; }
