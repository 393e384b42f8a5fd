// Inflates what the page holds, the scripts first.

async function inflate(name) {
  const node = document.getElementById(`data-${name}`);
  const text = atob(node.textContent);
  node.remove();
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

inflate("scripts").then((data) => {
  const script = document.createElement("script");
  script.textContent = `(() => { "use strict";\n${new TextDecoder().decode(data)}\n})();`;
  document.body.append(script);
}).catch((error) => {
  document.getElementById("loading").textContent = `The replay cannot be opened: ${error.message}. Use a current browser.`;
  throw error;
});
