// What modules of the page take from the browser as soon as they are loaded; to be imported before them.
import { webcrypto } from "node:crypto";

globalThis.crypto ??= webcrypto;
globalThis.location ??= { hash: "", pathname: "/", search: "" };
