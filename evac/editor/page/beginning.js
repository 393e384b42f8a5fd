// Asks what to begin with when nothing is edited yet.

async function base64Of(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  if (bytes.toBase64) return bytes.toBase64();
  let signs = "";
  for (let k = 0; k < bytes.length; k += 8192) signs += String.fromCharCode(...bytes.subarray(k, k + 8192));
  return btoa(signs);
}

function begin() {
  const form = by("begin-form"), button = by("begin-button");
  document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  let file = null;
  const open = () => { by("begin").close(); start().catch(failed); };
  function take(given) {
    if (!given) return;
    file = given;
    form.what.value = "file";
    by("begin-folder").value = given.name.replace(/\.[^.]*$/, "");
    by("begin-told").textContent = "";
  }
  by("begin-file").addEventListener("change", ({ target }) => take(target.files[0]));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    if (!by("begin").open) return;
    take(event.dataTransfer.files[0]);
    if (file) form.requestSubmit();
  });
  by("begin").addEventListener("cancel", (event) => event.preventDefault());
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    if (button.dataset.isReady) return open();
    const what = form.what.value, order = { folder: by("begin-folder").value.trim(), what };
    if (what === "file" && !file) { by("begin-told").textContent = "Choose a file, or drop one here"; return; }
    Object.assign(button, { disabled: true, textContent: what === "file" ? "Reading the file" : "Begin" });
    try {
      if (what === "file") Object.assign(order, { name: file.name, content: await base64Of(file) });
      const { told } = await ask("begin", order);
      if (!told.length) return open();
      by("begin-told").textContent = "";
      by("begin-list").replaceChildren(...told.map((line) => node("li", line)));
      button.dataset.isReady = true;
      button.textContent = "Open";
    } catch (error) {
      by("begin-told").textContent = error.message;
      button.textContent = "Begin";
    }
    button.disabled = false;
  });
  by("begin").showModal();
  by("verdict").textContent = "";
}
