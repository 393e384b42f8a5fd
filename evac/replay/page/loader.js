// Inflates what the page holds, the scripts first.

async function inflate(name) {
  const node = document.getElementById(`data-${name}`);
  const text = node.textContent;
  node.remove();
  const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const { writable, readable } = new DecompressionStream("deflate"), writer = writable.getWriter();
  writer.write(bytes).catch(() => {});  // Reading fails as well.
  writer.close().catch(() => {});
  return new Response(readable).arrayBuffer();
}

inflate("scripts").then((data) => {
  const script = document.createElement("script");
  script.textContent = `(() => { "use strict";\n${new TextDecoder().decode(data)}\n})();`;
  document.body.append(script);
}).catch((error) => {
  document.documentElement.className = "plain";
  const text = `The replay cannot be opened: ${error.message}. Use a current browser.`;
  Object.assign(document.getElementById("loading"), { className: "failed", textContent: text });
  throw error;
});
