"use strict";
addEventListener("beforeprint", () => {
  document.getElementById("printed").textContent = `Printed on ${new Date().toISOString().slice(0, 10)}.`;
});
