// Shading of the visible surface, once a pixel: the triangle is looked up by its identity and
// its vertices are interpolated at the pixel's centre.

@group(0) @binding(3) var<storage, read> colours: array<u32>;
@group(1) @binding(0) var identities: texture_2d<u32>;
// For each pixel, how much of the light is hidden from its point.
@group(1) @binding(1) var<storage, read> occlusion: array<u32>;

@vertex
fn shade_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers the picture, at infinity: the depth test passes where something
    // was drawn.
    let p = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(p * 4.0 - 1.0, 0.0, 1.0);
}

fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    let high = pow((c + 0.055) / 1.055, vec3(2.4));
    return select(high, c / 12.92, c <= vec3(0.04045));
}

// Linear light.
fn colour_of(vertex: u32) -> vec3<f32> {
    return linear_from_srgb(unpack4x8unorm(colours[vertex]).rgb);
}

@fragment
fn shade_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let identity = textureLoad(identities, vec2<i32>(pixel.xy), 0).x;
    let number = triangle_of(identity);
    // Triangles of other arenas are shaded by their own draw.
    if number == NONE {
        discard;
    }
    let back = (identity & BACK) != 0u;
    if back && frame.shading.z > 0.5 {
        return vec4(1.0, 0.0, 1.0, 1.0);
    }

    let seen = seen_point(number, in_picture(pixel.xy));
    let w = seen.weights;
    let a = indices[3u * number] & VERTEX;
    let b = indices[3u * number + 1u] & VERTEX;
    // Of a point the last one is no vertex.
    let of_point = is_point(number);
    let c = select(indices[3u * number + 2u] & VERTEX, a, of_point);
    let interpolated = w.x * octahedral(vertices[a].normal)
        + w.y * octahedral(vertices[b].normal)
        + w.z * octahedral(vertices[c].normal);
    let normal = select(interpolated, seen.across, of_point);
    let position = seen.world;
    var n = normalize((frame.world_from_model * vec4(normal, 0.0)).xyz);
    var albedo = frame.material.rgb;
    if frame.shading.y > 0.5 {
        albedo = w.x * colour_of(a) + w.y * colour_of(b) + w.z * colour_of(c);
    }

    // Open surfaces have two sides: the one that is seen faces the eye.
    let to_eye = normalize(select(frame.eye.xyz, frame.eye.xyz - position, frame.eye.w > 0.5));
    if CLIPPED && frame.bias.w > 0.5 {
        // The inside of a body: what is seen is the face in which it was cut. Skirts stand inside, too. Points
        // have no backs but their normals.
        let outwards = (frame.world_from_model * vec4(octahedral(vertices[a].normal), 0.0)).xyz;
        let inside = back || is_of_skirt(number) || (of_point && dot(outwards, to_eye) < 0.0);
        let clip = frame.clip_from_model * vec4(seen.model, 1.0);
        let plane = entered_plane(clip_place(in_picture(pixel.xy), clip.z / clip.w));
        if inside && plane < 3u {
            return vec4(frame.clip_colours[plane].rgb, 1.0);
        }
    }
    if back && frame.shading.w > 0.5 {
        n = -n;
    }

    // Lambert, a little specular (Blinn 1977), and ambient light that comes from above the eye's
    // side so that shadowed parts keep their shape.
    let to_light = normalize(select(frame.light.xyz, frame.light.xyz - position, frame.light.w > 0.5));
    var visibility = 1.0;
    if frame.shadow.x > 0.5 {
        visibility -= f32(occlusion[number_of(vec2<u32>(pixel.xy))]) / f32(HIDDEN);
    }
    let diffuse = visibility * max(dot(n, to_light), 0.0);
    let half_way = normalize(to_light + to_eye);
    let highlight = frame.material.a * pow(max(dot(n, half_way), 0.0), 24.0) * diffuse;
    let ambient = frame.shading.x * (0.6 + 0.4 * dot(n, to_eye));
    return vec4(albedo * (ambient + (1.0 - frame.shading.x) * diffuse) + highlight, 1.0);
}
