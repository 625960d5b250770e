// node validate.cjs PACKAGE LIMIT FILE...: a line of JSON for each file, with the validator's errors as [code, pointer] pairs.
const fs = require("fs");
const path = require("path");
const validator = require(process.argv[2]);

async function errorsOf(file) {
    const external = (uri) => fs.promises.readFile(path.join(path.dirname(file), decodeURIComponent(uri)))
        .then((data) => new Uint8Array(data));
    const options = { uri: path.basename(file), maxIssues: Number(process.argv[3]), externalResourceFunction: external };
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
    const errors = report.issues.messages.filter((message) => message.severity === 0);
    return errors.map((message) => [message.code, message.pointer || `offset ${message.offset}`]);
}

async function main() {
    for (const file of process.argv.slice(4)) {
        const errors = await errorsOf(file).catch((problem) => [["NOT_GLTF", String(problem)]]);
        console.log(JSON.stringify(errors));
    }
}

main();
