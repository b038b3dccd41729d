// Attitude, ground speed, height and heading on one canvas, with their setpoints.

import { fixed, heading, NONE, RAD_TO_DEG } from "../format";
import { colour } from "../theme";

export interface HorizonState {
  rollRad: number;
  pitchRad: number;
  yawRad: number;
  speed: number;
  height: number;
  rollSetRad: number;
  pitchSetRad: number;
  yawSetRad: number;
  speedSet: number;
  heightSet: number;
  stale: boolean;
}

type Pen = CanvasRenderingContext2D;

const TAPE_WIDTH = 62;
const PIXELS_PER_DEGREE = 4.6;
const TAPE_SPAN = 4;
const ROOMY_PX = 200;
const HEADING_SPAN_DEG = 70;

function font(pen: Pen, size: number, weight = 400): void {
  pen.font = `${weight} ${size}px ${getComputedStyle(document.documentElement).getPropertyValue("--sans")}`;
}

function line(pen: Pen, x0: number, y0: number, x1: number, y1: number): void {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

function ladder(pen: Pen, scale: number, small: number, roomy: boolean): void {
  pen.strokeStyle = pen.fillStyle = colour("text");
  pen.lineWidth = 1;
  font(pen, small);
  pen.textBaseline = "middle";
  for (let degrees = -30; degrees <= 30; degrees += 5) {
    if (degrees === 0) continue;
    const major = degrees % 10 === 0;
    if (!roomy && (!major || degrees > 10)) continue;
    const half = major ? (roomy ? 34 : 24) : 18;
    const y = -degrees * scale;
    line(pen, -half, y, half, y);
    if (!major) continue;
    pen.textAlign = "right";
    pen.fillText(String(Math.abs(degrees)), -half - 6, y);
    pen.textAlign = "left";
    pen.fillText(String(Math.abs(degrees)), half + 6, y);
  }
}

function rollScale(pen: Pen, radius: number): void {
  pen.strokeStyle = colour("text");
  for (const degrees of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
    const angle = (degrees - 90) / RAD_TO_DEG;
    const length = degrees % 30 === 0 ? 12 : 7;
    line(pen, Math.cos(angle) * radius, Math.sin(angle) * radius, Math.cos(angle) * (radius - length), Math.sin(angle) * (radius - length));
  }
}

function aircraft(pen: Pen, roomy: boolean): void {
  const [tip, root, drop] = roomy ? [68, 26, 8] : [52, 22, 6];
  for (const [width, ink] of [[5, "#0f1316"], [3, "#ffffff"]] as const) {
    pen.lineWidth = width;
    pen.strokeStyle = ink;
    pen.beginPath();
    pen.moveTo(-tip, 0); pen.lineTo(-root, 0); pen.lineTo(-root, drop);
    pen.moveTo(tip, 0); pen.lineTo(root, 0); pen.lineTo(root, drop);
    pen.stroke();
  }
  pen.fillStyle = "#ffffff";
  pen.strokeStyle = "#0f1316";
  pen.lineWidth = 1;
  pen.fillRect(-3.5, -3.5, 7, 7);
  pen.strokeRect(-3.5, -3.5, 7, 7);
}

// Commanded attitude: a thin dashed bar that the aircraft symbol should cover.
function attitudeSetpoint(pen: Pen, s: HorizonState, scale: number): void {
  if (!Number.isFinite(s.rollSetRad) || !Number.isFinite(s.pitchSetRad)) return;
  pen.save();
  pen.rotate(s.rollSetRad - s.rollRad);
  pen.translate(0, (s.pitchRad - s.pitchSetRad) * RAD_TO_DEG * scale);
  pen.strokeStyle = colour("text");
  pen.lineWidth = 1.5;
  pen.setLineDash([5, 4]);
  line(pen, -96, 0, -72, 0);
  line(pen, 72, 0, 96, 0);
  pen.restore();
}

function attitude(pen: Pen, box: Box, s: HorizonState, small: number): void {
  const scale = PIXELS_PER_DEGREE * Math.max(0.62, Math.min(1.4, box.height / 240));
  pen.save();
  pen.beginPath();
  pen.rect(box.x, box.y, box.width, box.height);
  pen.clip();
  pen.translate(box.x + box.width / 2, box.y + box.height / 2);
  const known = Number.isFinite(s.rollRad) && Number.isFinite(s.pitchRad);
  if (known) {
    pen.save();
    pen.rotate(-s.rollRad);
    pen.translate(0, s.pitchRad * RAD_TO_DEG * scale);
    const far = 2 * (box.width + box.height);
    pen.fillStyle = colour("sky");
    pen.fillRect(-far, -far, 2 * far, far);
    pen.fillStyle = colour("earth");
    pen.fillRect(-far, 0, 2 * far, far);
    pen.strokeStyle = colour("text");
    pen.lineWidth = 1.5;
    line(pen, -far, 0, far, 0);
    ladder(pen, scale, small, box.height > ROOMY_PX);
    pen.restore();
  } else {
    pen.fillStyle = colour("bg");
    pen.fillRect(-box.width, -box.height, 2 * box.width, 2 * box.height);
    pen.fillStyle = colour("text3");
    font(pen, small + 2);
    pen.textAlign = "center";
    pen.fillText("No attitude", 0, -30);
  }
  const radius = Math.min(box.width, box.height) / 2 - 6;
  if (known) {
    pen.save();
    pen.rotate(-s.rollRad);
    rollScale(pen, radius);
    pen.restore();
    pen.fillStyle = colour("text");
    pen.beginPath();
    pen.moveTo(0, -radius + 14); pen.lineTo(-6, -radius + 24); pen.lineTo(6, -radius + 24);
    pen.fill();
    attitudeSetpoint(pen, s, scale);
  }
  aircraft(pen, box.height > ROOMY_PX);
  pen.restore();
}

interface Tape {
  value: number;
  setpoint: number;
  lowest: number;
  decimals: number;
  side: "left" | "right";
}

function verticalTape(pen: Pen, box: Box, tape: Tape, stale: boolean, small: number, big: number): void {
  const { side } = tape;
  const inner = side === "left" ? box.x + box.width : box.x;
  const sign = side === "left" ? -1 : 1;
  pen.save();
  pen.beginPath();
  pen.rect(box.x, box.y, box.width, box.height);
  pen.clip();
  pen.fillStyle = colour("raise");
  pen.fillRect(box.x, box.y, box.width, box.height);
  const middle = box.y + box.height / 2;
  const scale = box.height / TAPE_SPAN;
  const tick = box.height > ROOMY_PX ? 0.25 : 0.5;
  const known = Number.isFinite(tape.value);
  const centre = known ? tape.value : 0;
  font(pen, small);
  pen.textBaseline = "middle";
  pen.textAlign = side === "left" ? "right" : "left";
  pen.strokeStyle = pen.fillStyle = colour("text2");
  const first = Math.ceil(Math.max(tape.lowest, centre - TAPE_SPAN / 2) / tick);
  for (let k = first; k * tick <= centre + TAPE_SPAN / 2; k++) {
    const y = middle - (k * tick - centre) * scale;
    const major = k % 2 === 0;
    line(pen, inner, y, inner + sign * (major ? 10 : 6), y);
    const cut = y < box.y + small / 2 || y > box.y + box.height - small / 2;
    if (major && !cut) pen.fillText(fixed(k * tick, 1), inner + sign * 16, y);
  }
  if (Number.isFinite(tape.setpoint) && known) bug(pen, inner, middle - Math.max(-TAPE_SPAN / 2, Math.min(TAPE_SPAN / 2, tape.setpoint - centre)) * scale, sign);
  pen.restore();
  valueBox(pen, { x: side === "left" ? box.x - 2 : box.x + 10, y: middle - big * 0.82, width: box.width - 8, height: big * 1.64 }, fixed(tape.value, tape.decimals), stale, big);
}

// Setpoint: an open triangle on the edge of the tape.
function bug(pen: Pen, x: number, y: number, sign: number): void {
  pen.strokeStyle = colour("text");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(x + sign * 8, y - 6);
  pen.lineTo(x + sign * 8, y + 6);
  pen.closePath();
  pen.stroke();
  pen.lineWidth = 1;
}

function valueBox(pen: Pen, box: Box, text: string, stale: boolean, big: number): void {
  pen.fillStyle = colour("bg");
  pen.strokeStyle = colour(stale ? "border" : "text");
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.rect(box.x, box.y, box.width, box.height);
  pen.fill();
  pen.stroke();
  font(pen, big, 600);
  pen.fillStyle = colour(stale ? "text3" : "text");
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(text, box.x + box.width / 2, box.y + box.height / 2 + 1);
}

function headingTape(pen: Pen, box: Box, s: HorizonState, small: number, big: number): void {
  pen.save();
  pen.beginPath();
  pen.rect(box.x, box.y, box.width, box.height);
  pen.clip();
  pen.fillStyle = colour("raise");
  pen.fillRect(box.x, box.y, box.width, box.height);
  const scale = box.width / HEADING_SPAN_DEG;
  const degrees = s.yawRad * RAD_TO_DEG;
  const middle = box.x + box.width / 2;
  if (Number.isFinite(degrees)) {
    font(pen, small);
    pen.strokeStyle = pen.fillStyle = colour("text2");
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (let mark = Math.ceil((degrees - HEADING_SPAN_DEG / 2) / 5) * 5; mark <= degrees + HEADING_SPAN_DEG / 2; mark += 5) {
      const x = middle + (mark - degrees) * scale;
      line(pen, x, box.y, x, box.y + (mark % 10 === 0 ? 6 : 4));
      if (mark % 10 === 0) pen.fillText(String((mark + 720) % 360).padStart(3, "0"), x, box.y + box.height * 0.62);
    }
    const off = ((s.yawSetRad * RAD_TO_DEG - degrees + 540) % 360) - 180;
    if (Number.isFinite(off)) {
      pen.save();
      pen.translate(middle + Math.max(-HEADING_SPAN_DEG / 2, Math.min(HEADING_SPAN_DEG / 2, off)) * scale, box.y + 1);
      pen.rotate(Math.PI / 2);
      bug(pen, 0, 0, 1);
      pen.restore();
    }
  }
  pen.restore();
  const width = big * 2.7;
  valueBox(pen, { x: middle - width / 2, y: box.y - 1, width, height: box.height }, Number.isFinite(s.yawRad) ? heading(s.yawRad) : NONE, s.stale, big);
}

export function drawHorizon(canvas: HTMLCanvasElement, s: HorizonState): void {
  const { clientWidth: width, clientHeight: height } = canvas;
  if (width === 0 || height === 0) return;
  const ratio = devicePixelRatio;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  if (!pen) return;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const large = width > 400;
  const small = large ? 12 : 11;
  const big = large ? 17 : 14;
  const inset = 10;
  const strip = large ? 30 : 26;
  const gap = large ? 10 : 6;
  const tape = large ? TAPE_WIDTH : 52;
  const bodyHeight = height - 2 * inset - strip - gap;
  const centre: Box = { x: inset + tape + gap, y: inset, width: width - 2 * (inset + tape + gap), height: bodyHeight };
  attitude(pen, centre, s, small);
  const left: Box = { x: inset, y: inset, width: tape, height: bodyHeight };
  const right: Box = { x: width - inset - tape, y: inset, width: tape, height: bodyHeight };
  verticalTape(pen, left, { value: s.speed, setpoint: s.speedSet, lowest: 0, decimals: 2, side: "left" }, s.stale, small, big);
  verticalTape(pen, right, { value: s.height, setpoint: s.heightSet, lowest: -Infinity, decimals: 2, side: "right" }, s.stale, small, big);
  headingTape(pen, { x: centre.x, y: inset + bodyHeight + gap, width: centre.width, height: strip }, s, small, big);
  captions(pen, left, right, height, inset + bodyHeight + gap, small);
}

function captions(pen: Pen, left: Box, right: Box, height: number, top: number, small: number): void {
  font(pen, small - 1);
  pen.fillStyle = colour("text3");
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const rows = Math.min(14, (height - top) / 2.4);
  pen.fillText(small > 11 ? "ground speed" : "speed", left.x + left.width / 2, top + rows * 0.6);
  pen.fillText("m/s", left.x + left.width / 2, top + rows * 1.55);
  pen.fillText("height", right.x + right.width / 2, top + rows * 0.6);
  pen.fillText("m", right.x + right.width / 2, top + rows * 1.55);
}
