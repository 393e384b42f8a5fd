// Inflates what the page holds, the scripts first.

async function inflate(name) {
  const node = document.getElementById(`data-${name}`);
  const text = node.textContent;
  node.remove();
  const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
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
