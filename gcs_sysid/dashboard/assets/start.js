"use strict";
// Begins when everything is there.
at("theme").onclick = () => {
  const dark = document.documentElement.classList.toggle("dark");
  try { localStorage.setItem("theme", dark ? "dark" : "light"); } catch (error) { /* private windows keep nothing */ }
  plots();
};
let kept = null;
try { kept = localStorage.getItem("theme"); } catch (error) { /* as above */ }
document.documentElement.classList.toggle("dark",
  kept ? kept === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches);
addEventListener("resize", plots);
setInterval(() => { if (newest) { alarms(newest, Math.max(late() - 1.5, 0)); streams(newest, Math.max(late() - 1.5, 0)); } }, 1000);
fetch("/history.json").then(answer => answer.json()).then(found => { past = found; }).finally(follow);
