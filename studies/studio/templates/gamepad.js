"use strict";
/* A gamepad of the browser. What its sticks do is sent while one is beyond the dead zone, and an
   untouched gamepad once when none is any more, when it is gone, or when the page is out of sight,
   where browsers keep what they read last. What axes mean is up to the program that is sent them. */
window.watchGamepad = (deadZone, send, show) => {
  const PERIOD = 50, isBeyond = (axis) => Math.abs(axis) > deadZone;
  let commands = false, shown = null;

  function held() {
    const found = [...(navigator.getGamepads?.() || [])].filter((own) => own && own.connected);
    const standard = found.filter((own) => own.mapping === "standard");
    return { any: found.length > 0, pad: standard.find((own) => own.axes.some(isBeyond)) || standard[0] };
  }

  function poll() {
    const { any, pad } = document.hidden ? { any: false } : held();
    const axes = pad ? pad.axes.map((axis) => Number(axis.toFixed(3))) : [];
    const touched = axes.some(isBeyond);
    if (touched || commands) send(touched ? axes : []);
    commands = touched;
    const words = !any ? "" : !pad ? "gamepad of another layout" : touched ? "gamepad commands" : "gamepad connected";
    if (words !== shown) show(shown = words);
  }

  window.addEventListener("gamepaddisconnected", poll);
  document.addEventListener("visibilitychange", poll);
  window.addEventListener("pagehide", () => { if (commands) send([]); });
  setInterval(poll, PERIOD);
};
