// Theme follows the system unless the user chose one; canvases read their colours from the same tokens as the style sheets.

export type ThemeChoice = "system" | "dark" | "light";
const KEY = "rotorlab.theme";

export function themeChoice(): ThemeChoice {
  const stored = localStorage.getItem(KEY);
  return stored === "dark" || stored === "light" ? stored : "system";
}

export function applyTheme(): void {
  const choice = themeChoice();
  const light = choice === "light" || (choice === "system" && matchMedia("(prefers-color-scheme: light)").matches);
  document.documentElement.dataset.theme = light ? "light" : "dark";
  cache.clear();
  version += 1;
}

export function chooseTheme(choice: ThemeChoice): void {
  if (choice === "system") localStorage.removeItem(KEY);
  else localStorage.setItem(KEY, choice);
  applyTheme();
}

const cache = new Map<string, string>();
let version = 0;

export function themeVersion(): number {
  return version;
}

export function colour(token: string): string {
  let value = cache.get(token);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(`--${token}`).trim();
    cache.set(token, value);
  }
  return value;
}

export function watchTheme(): void {
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", applyTheme);
  matchMedia("(min-width: 1600px)").addEventListener("change", applyTheme);
  matchMedia("(max-width: 1100px)").addEventListener("change", applyTheme);
}
